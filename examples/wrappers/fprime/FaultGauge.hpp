// An F Prime component around the exported step; FaultGauge.fpp says what comes and goes.
#ifndef FAULTS_FAULT_GAUGE_HPP
#define FAULTS_FAULT_GAUGE_HPP

#include "FaultGaugeComponentAc.hpp"
#include "tank.h"

namespace Faults {

class FaultGauge final : public FaultGaugeComponentBase {
  public:
    explicit FaultGauge(const char *name);

  private:
    // Guarded: the state is one caller's at a time.
    void sampleIn_handler(FwIndexType port, F64 t, F64 pump, F64 level) override;

    tank_state m_state;  // all memory there is
    I32 m_status;
};

}  // namespace Faults

#endif
