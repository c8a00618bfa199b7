/* Assignment for other C files: see assignment.py. */
#ifndef MDRIVE_ASSIGNMENT_H
#define MDRIVE_ASSIGNMENT_H

#include "../core/compiled/values.h"

/* What `assign` takes, and the pairs that it returns, by row: as many as columns at the most, freed by free_pairs. */
typedef struct {
    const double *cost;
    const unsigned char *possible;
    const int64_t *block;
    Py_ssize_t rows, columns, count;
    int64_t *row, *column;
} Pairs;
bool assign_pairs(Pairs *pairs);
void free_pairs(Pairs *pairs);
#endif
