// Sixteen-bit floats (IEEE 754 binary16): 1 sign, 5 exponent, 10 fraction bits.
#pragma once

#include <cstdint>

namespace arah::reference {

// The nearest half, ties to even; numbers beyond 65,504 become that, infinities and NaN stay.
double nearest_half(double value);

// Of a number that is a half; NaN of any kind becomes 0x7e00.
uint16_t half_bits(double half);
double half_value(uint16_t bits);

}  // namespace arah::reference
