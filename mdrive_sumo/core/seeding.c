/* Twins of seeding.py, with a hash of their own: hashlib's costs more than all else, and other C files draw here. */
#include "seeding.h"

#include <string.h>

#include "compiled/values.h"
#include "portable.h"

static const uint64_t START[8] = {0x6a09e667f3bcc908, 0xbb67ae8584caa73b, 0x3c6ef372fe94f82b, 0xa54ff53a5f1d36f1,
                                  0x510e527fade682d1, 0x9b05688c2b3e6c1f, 0x1f83d9abfb41bd6b, 0x5be0cd19137e2179};
static const unsigned char ORDER[10][16] = {
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
    {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4}, {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
    {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13}, {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
    {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11}, {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
    {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5}, {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};

static inline uint64_t turn(uint64_t word, int bits) { return word >> bits | word << (64 - bits); }

#define MIX(a, b, c, d, i)                                            \
    v[a] += v[b] + words[order[i]], v[d] = turn(v[d] ^ v[a], 32);     \
    v[c] += v[d], v[b] = turn(v[b] ^ v[c], 24);                       \
    v[a] += v[b] + words[order[i + 1]], v[d] = turn(v[d] ^ v[a], 16); \
    v[c] += v[d], v[b] = turn(v[b] ^ v[c], 63)

/* RFC 7693, section 3.2: hash a block with which so many bytes are hashed. */
static void compress(uint64_t *state, const unsigned char *block, uint64_t hashed, bool is_last) {
    uint64_t words[16], v[16];
    memcpy(words, block, BLOCK_BYTES); /* all machines that the layer is built for are little-endian */
    memcpy(v, state, sizeof START);
    memcpy(v + 8, START, sizeof START);
    v[12] ^= hashed;
    if (is_last) v[14] = ~v[14];
#pragma unroll
    for (int round = 0; round < 12; round++) {
        const unsigned char *order = ORDER[round % 10];
        MIX(0, 4, 8, 12, 0);
        MIX(1, 5, 9, 13, 2);
        MIX(2, 6, 10, 14, 4);
        MIX(3, 7, 11, 15, 6);
        MIX(0, 5, 10, 15, 8);
        MIX(1, 6, 11, 12, 10);
        MIX(2, 7, 8, 13, 12);
        MIX(3, 4, 9, 14, 14);
    }
    for (int i = 0; i < 8; i++) state[i] ^= v[i] ^ v[i + 8];
}

static void add_bytes(Purpose *purpose, const void *bytes, size_t length) {
    const unsigned char *next = bytes;
    while (length) {
        if (purpose->filled == BLOCK_BYTES) { /* not the last block: another byte follows */
            purpose->hashed += BLOCK_BYTES;
            compress(purpose->state, purpose->block, purpose->hashed, false);
            purpose->filled = 0;
        }
        size_t room = BLOCK_BYTES - purpose->filled, part = length < room ? length : room;
        memcpy(purpose->block + purpose->filled, next, part);
        purpose->filled += part, next += part, length -= part;
    }
}

static size_t write_number(int64_t number, char text[20]) {
    uint64_t rest = number < 0 ? -(uint64_t)number : (uint64_t)number;
    size_t first = 20;
    do text[--first] = (char)('0' + rest % 10);
    while (rest /= 10);
    if (number < 0) text[--first] = '-';
    memmove(text, text + first, 20 - first);
    return 20 - first;
}

static Purpose begin(void) {
    Purpose purpose;
    memcpy(purpose.state, START, sizeof START);
    purpose.state[0] ^= 0x01010000 ^ 64; /* no key, 64 bytes of result */
    purpose.hashed = purpose.filled = 0;
    return purpose;
}

Purpose start_purpose(int64_t seed) {
    Purpose purpose = begin();
    char text[20];
    add_bytes(&purpose, text, write_number(seed, text));
    return purpose;
}

void add_text(Purpose *purpose, const char *text, size_t length) {
    add_bytes(purpose, "", 1);
    add_bytes(purpose, text, length);
}

void add_number(Purpose *purpose, int64_t number) {
    char text[20];
    add_text(purpose, text, write_number(number, text));
}

static bool add_written(Purpose *purpose, PyObject *object, bool is_first) {
    PyObject *written = object->ob_type == &PyUnicode_Type ? new_reference(object) : PyObject_Str(object);
    Py_ssize_t length;
    const char *text = written ? PyUnicode_AsUTF8AndSize(written, &length) : NULL;
    if (text && is_first) add_bytes(purpose, text, (size_t)length);
    else if (text) add_text(purpose, text, (size_t)length);
    if (written) Py_DecRef(written);
    return text;
}

bool add_object(Purpose *purpose, PyObject *object) { return add_written(purpose, object, false); }

static void hash(const Purpose *purpose, uint64_t words[UNIFORMS]) {
    unsigned char block[BLOCK_BYTES] = {0};
    memcpy(block, purpose->block, purpose->filled);
    memcpy(words, purpose->state, sizeof purpose->state);
    compress(words, block, purpose->hashed + purpose->filled, true);
}

static double to_uniform(uint64_t word) { return (double)(word >> 11) * 0x1p-53; }

void draw_uniforms(const Purpose *purpose, double drawn[UNIFORMS]) {
    uint64_t words[UNIFORMS];
    hash(purpose, words);
    for (int i = 0; i < UNIFORMS; i++) drawn[i] = to_uniform(words[i]);
}

double draw_first_uniform(const Purpose *purpose) {
    uint64_t words[UNIFORMS];
    hash(purpose, words);
    return to_uniform(words[0]);
}

void draw_normals(const Purpose *purpose, double drawn[UNIFORMS]) {
    draw_uniforms(purpose, drawn);
    for (int i = 0; i < UNIFORMS; i += 2) {
        double radius = sqrt(-2 * portable_log(1 - drawn[i]));
        CosSin direction = cos_sin(TAU * drawn[i + 1]);
        drawn[i] = radius * direction.cos, drawn[i + 1] = radius * direction.sin;
    }
}

static bool read_purpose(PyObject *const *arguments, Py_ssize_t count, Purpose *purpose) {
    if (!expect_arguments("draw", count, 1, PTRDIFF_MAX)) return false;
    *purpose = begin();
    for (Py_ssize_t i = 0; i < count; i++)
        if (!add_written(purpose, arguments[i], i == 0)) return false;
    return true;
}

static PyObject *core_seeding_draw_uniforms(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Purpose purpose;
    if (!read_purpose(arguments, count, &purpose)) return NULL;
    double drawn[UNIFORMS];
    draw_uniforms(&purpose, drawn);
    return build_tuple(UNIFORMS, drawn);
}

static PyObject *core_seeding_draw_first_uniform(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Purpose purpose;
    return read_purpose(arguments, count, &purpose) ? PyFloat_FromDouble(draw_first_uniform(&purpose)) : NULL;
}

static PyObject *core_seeding_draw_normals(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Purpose purpose;
    if (!read_purpose(arguments, count, &purpose)) return NULL;
    double drawn[UNIFORMS];
    draw_normals(&purpose, drawn);
    return build_tuple(UNIFORMS, drawn);
}

Functions core_seeding = {
    FUNCTION(core_seeding_draw_uniforms),
    FUNCTION(core_seeding_draw_first_uniform),
    FUNCTION(core_seeding_draw_normals),
    END_OF_FUNCTIONS,
};
