/* A core Flight System app around the exported step: every sample message is one step; what it says
   goes out as telemetry, and a change of status is an event. */

#include <math.h>
#include <string.h>

#include "cfe.h"
#include "tank.h"

#define FAULT_APP_SAMPLE_MID 0x1890
#define FAULT_APP_TLM_MID    0x0890
#define FAULT_APP_DEPTH      8
#define FAULT_APP_STATUS_EID 1
#define FAULT_APP_LENGTH_EID 2

typedef struct
{
    CFE_MSG_CommandHeader_t header;
    double t;     /* s since the mission began */
    double pump;  /* V, as commanded */
    double level; /* m, as measured */
    bool fresh;   /* whether the level was sampled since the last message */
} fault_app_sample;

typedef struct
{
    CFE_MSG_TelemetryHeader_t header;
    tank_output said;
} fault_app_telemetry;

/* All memory there is: nothing is allocated. */
static struct
{
    tank_state state;
    fault_app_telemetry telemetry;
    int32_t status;
    CFE_SB_PipeId_t pipe;
} app;

static CFE_Status_t begun(void)
{
    CFE_Status_t done = CFE_EVS_Register(NULL, 0, CFE_EVS_EventFilter_BINARY);
    if (done == CFE_SUCCESS) {
        done = CFE_SB_CreatePipe(&app.pipe, FAULT_APP_DEPTH, "FAULT_PIPE");
    }
    if (done == CFE_SUCCESS) {
        done = CFE_SB_Subscribe(CFE_SB_ValueToMsgId(FAULT_APP_SAMPLE_MID), app.pipe);
    }
    (void)CFE_MSG_Init(CFE_MSG_PTR(app.telemetry.header), CFE_SB_ValueToMsgId(FAULT_APP_TLM_MID),
                       sizeof app.telemetry);
    tank_init(&app.state);
    app.status = TANK_NOT_JUDGED;
    return done;
}

static void sampled(const fault_app_sample *sample)
{
    const tank_input in = {
        .t = sample->t, .u = sample->pump, .level = sample->fresh ? sample->level : NAN};
    tank_output *const out = &app.telemetry.said;
    tank_step(&in, out, &app.state);
    if (out->status != app.status) {
        app.status = out->status;
        (void)CFE_EVS_SendEvent(FAULT_APP_STATUS_EID,
                                app.status == TANK_FAULT ? CFE_EVS_EventType_ERROR
                                                         : CFE_EVS_EventType_INFORMATION,
                                "status %d: leak %g m/s (%g to %g), p %.3f", (int)app.status,
                                (double)out->f_leak, (double)out->f_leak_lo,
                                (double)out->f_leak_hi, (double)out->p_leak);
    }
    CFE_SB_TimeStampMsg(CFE_MSG_PTR(app.telemetry.header));
    (void)CFE_SB_TransmitMsg(CFE_MSG_PTR(app.telemetry.header), true);
}

void FAULT_AppMain(void)
{
    uint32 run = begun() == CFE_SUCCESS ? CFE_ES_RunStatus_APP_RUN : CFE_ES_RunStatus_APP_ERROR;
    while (CFE_ES_RunLoop(&run)) {
        CFE_SB_Buffer_t *buffer = NULL;
        CFE_MSG_Size_t size = 0;
        if (CFE_SB_ReceiveBuffer(&buffer, app.pipe, CFE_SB_PEND_FOREVER) != CFE_SUCCESS) {
            run = CFE_ES_RunStatus_APP_ERROR;
            continue;
        }
        (void)CFE_MSG_GetSize(&buffer->Msg, &size);
        if (size == sizeof(fault_app_sample)) {
            fault_app_sample sample;
            memcpy(&sample, buffer, sizeof sample);
            sampled(&sample);
        } else {
            (void)CFE_EVS_SendEvent(FAULT_APP_LENGTH_EID, CFE_EVS_EventType_ERROR,
                                    "a sample of %lu bytes in place of %lu", (unsigned long)size,
                                    (unsigned long)sizeof(fault_app_sample));
        }
    }
    CFE_ES_ExitApp(run);
}
