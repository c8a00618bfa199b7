/* Random numbers by purpose, the twins of seeding.py, for other C files:

       Purpose purpose = start_purpose(seed);
       add_text(&purpose, "miss", 4);
       add_number(&purpose, epoch);
       draw_uniforms(&purpose, drawn);

   A purpose can be copied, so that a common beginning is hashed once; drawing leaves it as it is. */
#ifndef MDRIVE_SEEDING_H
#define MDRIVE_SEEDING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "compiled/python_abi.h"

enum { UNIFORMS = 8, BLOCK_BYTES = 128 };

/* A hash (BLAKE2b with 64 bytes, RFC 7693) of a seed, names and numbers, joined by zero bytes. */
typedef struct {
    uint64_t state[8], hashed; /* bytes before the block */
    size_t filled;             /* bytes of the block */
    unsigned char block[BLOCK_BYTES];
} Purpose;

Purpose start_purpose(int64_t seed);
void add_text(Purpose *purpose, const char *text, size_t length);
void add_number(Purpose *purpose, int64_t number);
/* A str or an int of Python. */
bool add_object(Purpose *purpose, PyObject *object);

void draw_uniforms(const Purpose *purpose, double drawn[UNIFORMS]);
double draw_first_uniform(const Purpose *purpose);
void draw_normals(const Purpose *purpose, double drawn[UNIFORMS]);
#endif
