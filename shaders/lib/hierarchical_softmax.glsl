// The hierarchical softmax over a rig's tree of joints, forward and backward; formulas and the order of the logits:
// kernels/reference/hierarchical_softmax.h. The tree comes in specialization constants (kernels/skinning/joint_tree.h), so
// that all loops unroll to straight-line code in which every array is indexed by constants and lives in registers.
// Includers bind `logit_texels`, a readonly imageBuffer, before this file. Constants 0 to 65 belong to this file.
#ifndef ARAH_LIB_HIERARCHICAL_SOFTMAX_GLSL
#define ARAH_LIB_HIERARCHICAL_SOFTMAX_GLSL

#include "lib/finite.glsl"

layout(constant_id = 0) const int JOINTS = 1;
layout(constant_id = 1) const int LOGIT_GROUPS = 1;  // padded logits / 8
// parent | gate << 8; the gate is the slot of the logit that decides how much a joint passes on, NO_GATE for a leaf
layout(constant_id = 2) const int JOINT_0 = 65280;
layout(constant_id = 3) const int JOINT_1 = 65280;
layout(constant_id = 4) const int JOINT_2 = 65280;
layout(constant_id = 5) const int JOINT_3 = 65280;
layout(constant_id = 6) const int JOINT_4 = 65280;
layout(constant_id = 7) const int JOINT_5 = 65280;
layout(constant_id = 8) const int JOINT_6 = 65280;
layout(constant_id = 9) const int JOINT_7 = 65280;
layout(constant_id = 10) const int JOINT_8 = 65280;
layout(constant_id = 11) const int JOINT_9 = 65280;
layout(constant_id = 12) const int JOINT_10 = 65280;
layout(constant_id = 13) const int JOINT_11 = 65280;
layout(constant_id = 14) const int JOINT_12 = 65280;
layout(constant_id = 15) const int JOINT_13 = 65280;
layout(constant_id = 16) const int JOINT_14 = 65280;
layout(constant_id = 17) const int JOINT_15 = 65280;
layout(constant_id = 18) const int JOINT_16 = 65280;
layout(constant_id = 19) const int JOINT_17 = 65280;
layout(constant_id = 20) const int JOINT_18 = 65280;
layout(constant_id = 21) const int JOINT_19 = 65280;
layout(constant_id = 22) const int JOINT_20 = 65280;
layout(constant_id = 23) const int JOINT_21 = 65280;
layout(constant_id = 24) const int JOINT_22 = 65280;
layout(constant_id = 25) const int JOINT_23 = 65280;
layout(constant_id = 26) const int JOINT_24 = 65280;
layout(constant_id = 27) const int JOINT_25 = 65280;
layout(constant_id = 28) const int JOINT_26 = 65280;
layout(constant_id = 29) const int JOINT_27 = 65280;
layout(constant_id = 30) const int JOINT_28 = 65280;
layout(constant_id = 31) const int JOINT_29 = 65280;
layout(constant_id = 32) const int JOINT_30 = 65280;
layout(constant_id = 33) const int JOINT_31 = 65280;
layout(constant_id = 34) const int JOINT_32 = 65280;
layout(constant_id = 35) const int JOINT_33 = 65280;
layout(constant_id = 36) const int JOINT_34 = 65280;
layout(constant_id = 37) const int JOINT_35 = 65280;
layout(constant_id = 38) const int JOINT_36 = 65280;
layout(constant_id = 39) const int JOINT_37 = 65280;
layout(constant_id = 40) const int JOINT_38 = 65280;
layout(constant_id = 41) const int JOINT_39 = 65280;
layout(constant_id = 42) const int JOINT_40 = 65280;
layout(constant_id = 43) const int JOINT_41 = 65280;
layout(constant_id = 44) const int JOINT_42 = 65280;
layout(constant_id = 45) const int JOINT_43 = 65280;
layout(constant_id = 46) const int JOINT_44 = 65280;
layout(constant_id = 47) const int JOINT_45 = 65280;
layout(constant_id = 48) const int JOINT_46 = 65280;
layout(constant_id = 49) const int JOINT_47 = 65280;
layout(constant_id = 50) const int JOINT_48 = 65280;
layout(constant_id = 51) const int JOINT_49 = 65280;
layout(constant_id = 52) const int JOINT_50 = 65280;
layout(constant_id = 53) const int JOINT_51 = 65280;
layout(constant_id = 54) const int JOINT_52 = 65280;
layout(constant_id = 55) const int JOINT_53 = 65280;
layout(constant_id = 56) const int JOINT_54 = 65280;
layout(constant_id = 57) const int JOINT_55 = 65280;
layout(constant_id = 58) const int JOINT_56 = 65280;
layout(constant_id = 59) const int JOINT_57 = 65280;
layout(constant_id = 60) const int JOINT_58 = 65280;
layout(constant_id = 61) const int JOINT_59 = 65280;
layout(constant_id = 62) const int JOINT_60 = 65280;
layout(constant_id = 63) const int JOINT_61 = 65280;
layout(constant_id = 64) const int JOINT_62 = 65280;
layout(constant_id = 65) const int JOINT_63 = 65280;

const int NO_GATE = 255;
const float LOGIT_SCALE = 20.0;  // ARAH.md section 2

int joint_words[64] = int[64](
    JOINT_0, JOINT_1, JOINT_2, JOINT_3, JOINT_4, JOINT_5, JOINT_6, JOINT_7, JOINT_8, JOINT_9, JOINT_10, JOINT_11,
    JOINT_12, JOINT_13, JOINT_14, JOINT_15, JOINT_16, JOINT_17, JOINT_18, JOINT_19, JOINT_20, JOINT_21, JOINT_22,
    JOINT_23, JOINT_24, JOINT_25, JOINT_26, JOINT_27, JOINT_28, JOINT_29, JOINT_30, JOINT_31, JOINT_32, JOINT_33,
    JOINT_34, JOINT_35, JOINT_36, JOINT_37, JOINT_38, JOINT_39, JOINT_40, JOINT_41, JOINT_42, JOINT_43, JOINT_44,
    JOINT_45, JOINT_46, JOINT_47, JOINT_48, JOINT_49, JOINT_50, JOINT_51, JOINT_52, JOINT_53, JOINT_54, JOINT_55,
    JOINT_56, JOINT_57, JOINT_58, JOINT_59, JOINT_60, JOINT_61, JOINT_62, JOINT_63);
int parent_of(int joint) { return joint_words[joint] & 255; }
int gate_of(int joint) { return joint_words[joint] >> 8; }
// A single child takes all that its parent passes on: its own logit is the parent's gate, and there is no softmax.
bool is_single(int joint) { return gate_of(parent_of(joint)) == joint; }

float logits[96];  // scaled
float mass[64];    // m_j: what reaches joint j from its parent
float passed[64];  // sigmoid(gate): the share that goes on to the children
float kept[64];    // 1 - passed, without cancellation
float share[64];   // softmax among the siblings

// Texel `first` of logit_texels holds the row's first four logits.
void load_logits(int first) {
  [[unroll]] for (int i = 0; i < 2 * LOGIT_GROUPS; ++i) {
    const vec4 texel = LOGIT_SCALE * imageLoad(logit_texels, first + i);
    [[unroll]] for (int k = 0; k < 4; ++k) logits[4 * i + k] = texel[k];
  }
}

// Fills mass, passed, kept and share. Exponents are never positive, so no logit overflows; a logit that is not a number
// makes every weight NaN on every device (minimum and maximum would hide it on some).
void distribute_mass() {
  float largest[64], total[64];
  float magnitude = 0.0;
  [[unroll]] for (int j = 0; j < JOINTS; ++j) {
    largest[j] = -3.0e38;
    total[j] = 0.0;
  }
  [[unroll]] for (int j = 1; j < JOINTS; ++j) {
    if (!is_single(j)) {
      largest[parent_of(j)] = max(largest[parent_of(j)], logits[j]);
      magnitude += abs(logits[j]);
    }
  }
  [[unroll]] for (int j = 1; j < JOINTS; ++j) {
    share[j] = 1.0;
    if (!is_single(j)) {
      share[j] = exp(logits[j] - largest[parent_of(j)]);
      total[parent_of(j)] += share[j];
    }
  }
  [[unroll]] for (int j = 0; j < JOINTS; ++j) {
    kept[j] = 1.0;
    passed[j] = 0.0;
    if (gate_of(j) != NO_GATE) {
      const float gate = logits[gate_of(j)];
      magnitude += abs(gate);
      const float e = exp(-abs(gate));
      const float larger = 1.0 / (1.0 + e), smaller = e * larger;
      passed[j] = gate >= 0.0 ? larger : smaller;
      kept[j] = gate >= 0.0 ? smaller : larger;
    }
  }
  mass[0] = is_finite(magnitude) ? 1.0 : uintBitsToFloat(0x7fc00000u);
  [[unroll]] for (int j = 1; j < JOINTS; ++j) {
    if (!is_single(j)) share[j] /= total[parent_of(j)];
    mass[j] = mass[parent_of(j)] * passed[parent_of(j)] * share[j];
  }
}

float weight_of(int joint) { return mass[joint] * kept[joint]; }

float d_weights[64];  // dL/dw_j: given
float d_logits[96];   // dL/dlogit before the scale: found

void pull_back_to_logits() {
  float d_mass[64], mean[64];  // mean: of the children's d_mass under the softmax
  [[unroll]] for (int i = 0; i < 8 * LOGIT_GROUPS; ++i) d_logits[i] = 0.0;
  [[unroll]] for (int j = 0; j < JOINTS; ++j) mean[j] = 0.0;
  [[unroll]] for (int i = 0; i < JOINTS; ++i) {
    const int j = JOINTS - 1 - i;  // children before their parents
    d_mass[j] = d_weights[j] * kept[j] + passed[j] * mean[j];
    if (j > 0) mean[parent_of(j)] += share[j] * d_mass[j];
    if (gate_of(j) != NO_GATE) d_logits[gate_of(j)] += LOGIT_SCALE * mass[j] * passed[j] * kept[j] * (mean[j] - d_weights[j]);
  }
  [[unroll]] for (int j = 1; j < JOINTS; ++j) {
    const int parent = parent_of(j);
    if (!is_single(j)) d_logits[j] += LOGIT_SCALE * mass[parent] * passed[parent] * share[j] * (d_mass[j] - mean[parent]);
  }
}

#endif
