// What F Prime's autocoder makes of FaultGauge.fpp, as far as the component calls it. It is for
// compilers alone: take the real one.
#ifndef FAULTS_FAULT_GAUGE_COMPONENT_AC_HPP
#define FAULTS_FAULT_GAUGE_COMPONENT_AC_HPP

#include <cstdint>

using F64 = double;
using I32 = std::int32_t;
using FwIndexType = std::int16_t;

namespace Faults {

class FaultGaugeComponentBase {
  public:
    explicit FaultGaugeComponentBase(const char *) {}
    virtual ~FaultGaugeComponentBase() = default;

  protected:
    virtual void sampleIn_handler(FwIndexType port, F64 t, F64 pump, F64 level) = 0;
    void tlmWrite_Leak(F64) {}
    void tlmWrite_LeakLow(F64) {}
    void tlmWrite_LeakHigh(F64) {}
    void tlmWrite_LeakProbability(F64) {}
    void tlmWrite_Status(I32) {}
    void log_WARNING_HI_StatusChanged(I32, F64, F64) {}
};

}  // namespace Faults

#endif
