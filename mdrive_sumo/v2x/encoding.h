/* Bytes of messages, for other C files: those of encoding.py. All machines are little-endian. */
#ifndef MDRIVE_ENCODING_H
#define MDRIVE_ENCODING_H

#include <string.h>

#include "../core/compiled/values.h"

/* The bytes of a message; what is written goes to `next`. */
typedef struct {
    unsigned char *next;
} Writer;

static inline void write_bytes(Writer *to, const void *value, size_t size) {
    memcpy(to->next, value, size);
    to->next += size;
}
static inline void write_8(Writer *to, long long value) { *to->next++ = (unsigned char)value; }
static inline void write_16(Writer *to, long long value) { write_bytes(to, &(uint16_t){(uint16_t)value}, 2); }
static inline void write_32(Writer *to, long long value) { write_bytes(to, &(uint32_t){(uint32_t)value}, 4); }

static inline uint16_t read_16(const unsigned char *from) {
    uint16_t value;
    memcpy(&value, from, sizeof value);
    return value;
}
static inline uint32_t read_32(const unsigned char *from) {
    uint32_t value;
    memcpy(&value, from, sizeof value);
    return value;
}

/* A content.ReferencePose without its tick. */
typedef struct {
    double x, y, yaw, position_sigma, yaw_sigma;
} Pose;
bool read_pose(PyObject *object, Pose *pose);

bool refuse_content(const char *text); /* MessageError; false */
/* As round_and_clamp, and not below `least`. */
bool round_and_clamp(double value, int bits, double least, long long *result);
/* As encode_points; xy (N, 2). */
bool write_points(const Pose *pose, const Array *xy, Writer *to);
#endif
