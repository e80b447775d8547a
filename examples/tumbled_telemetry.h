/* UDP telemetry of tumbled, layout 1. Generated from the daemon's table of fields: do not edit.
 *
 * One datagram is one struct of 296 bytes, little-endian, without gaps. docs/telemetry.md describes it, and
 * telemetry_client.c reads it. What is not known is NaN.
 */
#ifndef TUMBLED_TELEMETRY_H
#define TUMBLED_TELEMETRY_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define TUMBLED_TELEMETRY_MAGIC   "TMBL"
#define TUMBLED_TELEMETRY_VERSION 1
#define TUMBLED_TELEMETRY_SIZE    296

enum tumbled_origin { TUMBLED_LIVE = 1, TUMBLED_REPLAY = 2, TUMBLED_SIMULATED = 3 };
enum tumbled_mode {
    TUMBLED_NO_TARGET = 0, TUMBLED_ACQUIRING = 1, TUMBLED_TRACKING = 2, TUMBLED_PREDICTED = 3, TUMBLED_LOST = 4
};
enum tumbled_validity { TUMBLED_INVALID = 0, TUMBLED_DEGRADED = 1, TUMBLED_OK = 2 };
enum tumbled_kind { TUMBLED_EPOCH = 1, TUMBLED_PREDICTION = 2 };

#define TUMBLED_REASON_NO_POINTS     (UINT32_C(1) << 0) /* nothing stands in the region of interest */
#define TUMBLED_REASON_FEW_POINTS    (UINT32_C(1) << 1) /* too few points belong to the target */
#define TUMBLED_REASON_POOR_FIT      (UINT32_C(1) << 2) /* the points lie badly on the model */
#define TUMBLED_REASON_DEGENERATE    (UINT32_C(1) << 3) /* the points leave a direction open */
#define TUMBLED_REASON_REJECTED      (UINT32_C(1) << 4) /* the measurement is farther from the prediction than both explain */
#define TUMBLED_REASON_SETTLING      (UINT32_C(1) << 5) /* the motion is not known yet */
#define TUMBLED_REASON_ONE_SENSOR    (UINT32_C(1) << 6) /* only one sensor has measured lately */
#define TUMBLED_REASON_AMBIGUOUS     (UINT32_C(1) << 7) /* several things, or several poses, explain what was seen */
#define TUMBLED_REASON_STALE         (UINT32_C(1) << 8) /* nothing was measured for longer than the prediction is good for */
#define TUMBLED_REASON_EXTRINSIC     (UINT32_C(1) << 9) /* the sensors disagree by more than their mountings' uncertainty */
#define TUMBLED_REASON_MANOEUVRE     (UINT32_C(1) << 10) /* the motion has just changed: something pushed the target, or its stage starts or stops */
#define TUMBLED_REASON_LEARNING      (UINT32_C(1) << 11) /* the empty room is being learned: nothing is looked for */
#define TUMBLED_REASON_UNRECOGNISED  (UINT32_C(1) << 12) /* what is seen is not recognised as the target whose model is given */
#define TUMBLED_REASON_OTHER         (UINT32_C(1) << 31) /* one that this layout has no bit for */

struct tumbled_telemetry {
    uint8_t  magic[4];                 /* TMBL. */
    uint16_t version;                  /* 1. Any other: another layout. */
    uint16_t size;                     /* Bytes of the datagram. */
    uint8_t  origin;                   /* Where the data come from: 1 live, 2 replay, 3 simulated. Take nothing but 1 for a measurement. */
    uint8_t  mode;                     /* 0 no_target, 1 acquiring, 2 tracking, 3 predicted, 4 lost. */
    uint8_t  validity;                 /* 0 invalid, 1 degraded, 2 ok. Do not use what is invalid. */
    uint8_t  kind;                     /* 1 epoch: of a measurement; 2 predicted: to the time of sending. */
    uint32_t sequence;                 /* Counts the datagrams of a session from 0, those that could not be sent too; it wraps. */
    uint8_t  session[16];              /* The session: another one, and t_ns and sequence start anew. */
    int64_t  t_ns;                     /* ns on the session's timeline: the time for which all this holds. */
    int64_t  unix_ns;                  /* The same on the wall clock of the daemon's machine, ns since 1970-01-01 UTC. */
    uint64_t epoch;                    /* The epoch that it is from; of a prediction the last one. */
    double   position_m[3];            /* m, rig axes: the origin of the target frame. */
    double   rotation_xyzw[4];         /* Quaternion of length 1: target axes to rig axes. */
    double   velocity_mps[3];          /* m/s, rig axes: of the origin of the target frame. */
    double   angular_velocity_rps[3];  /* rad/s, rig axes. */
    double   spin_axis[3];             /* Of length 1, rig axes, right-handed. NaN: no spin that is more than noise. */
    double   spin_rate_rps;            /* rad/s, above 0; NaN with spin_axis. */
    double   sigma[12];                /* One standard deviation each: rotation about the target's x, y, z (rad), position along them (m), velocity (m/s) and angular velocity (rad/s) along the rig's. */
    uint32_t reasons;                  /* Why it is not fully valid: a bit each, see the table. */
    uint32_t crc32;                    /* CRC-32 (IEEE 802.3) of all bytes before it. */
};

static_assert(sizeof(struct tumbled_telemetry) == TUMBLED_TELEMETRY_SIZE, "the compiler leaves gaps");
static_assert(offsetof(struct tumbled_telemetry, crc32) == TUMBLED_TELEMETRY_SIZE - 4, "the compiler leaves gaps");

/* CRC-32 (IEEE 802.3): polynomial 0xEDB88320 reflected, begun and ended with all ones. */
static inline uint32_t tumbled_crc32(const unsigned char *bytes, size_t count)
{
    uint32_t crc = UINT32_C(0xFFFFFFFF);
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (UINT32_C(0xEDB88320) & (UINT32_C(0) - (crc & 1)));
    }
    return ~crc;
}

/* Reads a datagram on a little-endian machine. Returns NULL, or what is wrong with it. It does not look at the origin:
 * take nothing but TUMBLED_LIVE for a measurement. */
static inline const char *tumbled_telemetry_read(const unsigned char *bytes, size_t count,
                                                 struct tumbled_telemetry *out)
{
    const uint16_t one = 1;
    unsigned char low;
    memcpy(&low, &one, 1);
    if (low != 1)
        return "this machine is big-endian";
    if (count < 8 || memcmp(bytes, TUMBLED_TELEMETRY_MAGIC, 4) != 0)
        return "not telemetry of tumbled";
    if (bytes[4] != (TUMBLED_TELEMETRY_VERSION & 0xFF) || bytes[5] != (TUMBLED_TELEMETRY_VERSION >> 8))
        return "another layout: use the client that came with the daemon";
    if (count != TUMBLED_TELEMETRY_SIZE)
        return "another length";
    memcpy(out, bytes, sizeof *out);
    if (out->size != TUMBLED_TELEMETRY_SIZE)
        return "another length";
    if (out->crc32 != tumbled_crc32(bytes, TUMBLED_TELEMETRY_SIZE - 4))
        return "damaged: the checksum does not fit";
    return NULL;
}

#endif
