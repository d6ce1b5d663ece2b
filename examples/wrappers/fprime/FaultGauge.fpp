module Faults {

  @ One sample of the tank
  port Sample(
    t: F64 @< s since the mission began
    pump: F64 @< V, as commanded
    level: F64 @< m, as measured; NaN: not sampled
  )

  @ What the exported step says of the tank
  passive component FaultGauge {

    @ One call is one step
    guarded input port sampleIn: Sample

    time get port timeCaller
    telemetry port tlmOut
    event port eventOut
    text event port textEventOut

    telemetry Leak: F64 @< m/s: mean over all hypotheses
    telemetry LeakLow: F64
    telemetry LeakHigh: F64
    telemetry LeakProbability: F64
    telemetry Status: I32

    event StatusChanged(status: I32, leak: F64, p: F64) \
      severity warning high format "status {}: leak {} m/s, p {}"

  }

}
