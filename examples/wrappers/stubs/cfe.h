/* Just as much of cFE's interface as the app calls. It is for compilers alone: take the real one. */
#ifndef CFE_H
#define CFE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef int32_t CFE_Status_t;
typedef uint32_t uint32;
typedef uint16_t uint16;
typedef size_t CFE_MSG_Size_t;
typedef struct { uint8_t bytes[8]; } CFE_MSG_Message_t;
typedef struct { CFE_MSG_Message_t Msg; } CFE_MSG_CommandHeader_t;
typedef struct { CFE_MSG_Message_t Msg; uint8_t Spare[8]; } CFE_MSG_TelemetryHeader_t;
typedef union { CFE_MSG_Message_t Msg; long long LongInt; double LongDouble; } CFE_SB_Buffer_t;
typedef uint32_t CFE_SB_MsgId_t;
typedef uint32_t CFE_SB_PipeId_t;

#define CFE_SUCCESS ((CFE_Status_t)0)
#define CFE_MSG_PTR(header) (&(header).Msg)
#define CFE_SB_PEND_FOREVER (-1)
#define CFE_ES_RunStatus_APP_RUN 1
#define CFE_ES_RunStatus_APP_ERROR 3
#define CFE_EVS_EventFilter_BINARY 0
#define CFE_EVS_EventType_INFORMATION 2
#define CFE_EVS_EventType_ERROR 3

CFE_Status_t CFE_EVS_Register(const void *filters, uint16 count, uint16 scheme);
CFE_Status_t CFE_EVS_SendEvent(uint16 event, uint16 type, const char *format, ...);
CFE_SB_MsgId_t CFE_SB_ValueToMsgId(uint32 value);
CFE_Status_t CFE_SB_CreatePipe(CFE_SB_PipeId_t *pipe, uint16 depth, const char *name);
CFE_Status_t CFE_SB_Subscribe(CFE_SB_MsgId_t message, CFE_SB_PipeId_t pipe);
CFE_Status_t CFE_SB_ReceiveBuffer(CFE_SB_Buffer_t **buffer, CFE_SB_PipeId_t pipe, int32_t timeout);
CFE_Status_t CFE_SB_TransmitMsg(const CFE_MSG_Message_t *message, bool counted);
void CFE_SB_TimeStampMsg(CFE_MSG_Message_t *message);
CFE_Status_t CFE_MSG_Init(CFE_MSG_Message_t *message, CFE_SB_MsgId_t id, CFE_MSG_Size_t size);
CFE_Status_t CFE_MSG_GetSize(const CFE_MSG_Message_t *message, CFE_MSG_Size_t *size);
bool CFE_ES_RunLoop(uint32 *status);
void CFE_ES_ExitApp(uint32 status);

#endif
