#include "FaultGauge.hpp"

namespace Faults {

FaultGauge::FaultGauge(const char *name)
    : FaultGaugeComponentBase(name), m_state(), m_status(TANK_NOT_JUDGED) {
    tank_init(&m_state);
}

void FaultGauge::sampleIn_handler(FwIndexType, F64 t, F64 pump, F64 level) {
    tank_input in;
    in.t = t;
    in.u = pump;
    in.level = level;
    tank_output out;
    tank_step(&in, &out, &m_state);
    this->tlmWrite_Leak(out.f_leak);
    this->tlmWrite_LeakLow(out.f_leak_lo);
    this->tlmWrite_LeakHigh(out.f_leak_hi);
    this->tlmWrite_LeakProbability(out.p_leak);
    this->tlmWrite_Status(out.status);
    if (out.status != m_status) {
        m_status = out.status;
        this->log_WARNING_HI_StatusChanged(m_status, out.f_leak, out.p_leak);
    }
}

}  // namespace Faults
