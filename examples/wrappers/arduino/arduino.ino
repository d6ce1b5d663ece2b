// A sketch around the exported step: export with `--precision single --tanh fast` for a board whose
// processor counts in float (Teensy 4, Portenta, Giga), and put tank.h, tank.c and tank_tables.c
// beside this file. TANK_SAVED and the README beside them say how much memory it takes: an Uno has
// not enough.
#include "tank.h"

const int PUMP = 3, LEVEL = A0;
const unsigned long STEP = 1000;      // ms: the step of the model
const float VOLTS = 12.0f / 255.0f;   // of the pump, per unit of its duty
const float METRES = 1.0f / 1023.0f;  // of the level, per unit of the converter

static tank_state state;  // static: far too large for the stack
static uint8_t duty = 128;
static unsigned long due = 0, samples = 0;

void setup() {
    Serial.begin(115200);
    tank_init(&state);
    due = millis();
}

void loop() {
    if (static_cast<long>(millis() - due) < 0) return;
    due += STEP;
    analogWrite(PUMP, duty);
    tank_input in;
    // counted, not read from a clock that begins anew after 50 days
    in.t = 1e-3 * STEP * samples++;
    in.u = duty * VOLTS;
    in.level = analogRead(LEVEL) * METRES;
    tank_output out;
    tank_step(&in, &out, &state);
    Serial.print(out.f_leak, 6);
    Serial.print(" m/s, p ");
    Serial.print(out.p_leak, 3);
    Serial.println(out.status == TANK_FAULT ? ": FAULT" : "");
}
