// Just as much of Arduino's interface as the sketch calls. It is for compilers alone.
#ifndef ARDUINO_H
#define ARDUINO_H

#include <stdint.h>

const int A0 = 14;
unsigned long millis();
int analogRead(int pin);
void analogWrite(int pin, int value);

struct Printer {
    void begin(unsigned long baud);
    void print(double number, int digits);
    void print(const char *text);
    void println(const char *text);
};
extern Printer Serial;

#endif
