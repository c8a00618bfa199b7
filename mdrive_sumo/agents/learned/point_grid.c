/* Twin of point_grid.py: a scan as its occupied cells. */
#include <stdlib.h>
#include <string.h>

#include "../../core/compiled/values.h"

enum { CELLS = 256, LAYERS = 8, EDGES = LAYERS - 1, SIZE = LAYERS * CELLS * CELLS, MOST = 255 };
static const float PER_METRE = 2.5f, REACH_M = 51.2f;

/* Adds all points inside the grid to their cells and returns how many cells have some. */
static Py_ssize_t count_in_cells(const Array *points, const float *edges, unsigned char *grid) {
    const float *point = points->data;
    Py_ssize_t occupied = 0;
    for (Py_ssize_t i = 0; i < points->shape[0]; i++, point += points->shape[1]) {
        float row = (REACH_M - point[0]) * PER_METRE, column = (REACH_M - point[1]) * PER_METRE;
        if (!(row >= 0.0f && row < CELLS && column >= 0.0f && column < CELLS)) continue;
        int layer = 0;
        for (int k = 0; k < EDGES; k++) layer += point[2] >= edges[k];
        unsigned char *cell = grid + ((layer * CELLS + (int)row) * CELLS + (int)column);
        occupied += !*cell;
        if (*cell < MOST) ++*cell;
    }
    return occupied;
}

static void list_cells(const unsigned char *grid, int64_t *cells) {
    for (int64_t start = 0; start < SIZE; start += 8) {
        uint64_t eight;
        memcpy(&eight, grid + start, sizeof eight);
        if (!eight) continue;
        for (int64_t i = start; i < start + 8; i++)
            if (grid[i]) *cells++ = i * 256 + grid[i];
    }
}

static PyObject *count_checked(const Array *points, const Array *edges) {
    if (points->dimensions != 2 || points->shape[1] < 3 || edges->count != EDGES) {
        PyErr_SetString(PyExc_ValueError, "expected points (N, 3 or more) and an edge between each two layers");
        return NULL;
    }
    unsigned char *grid = calloc(SIZE, 1);
    if (!grid) return PyErr_NoMemory();
    Py_ssize_t occupied = count_in_cells(points, edges->data, grid);
    int64_t *cells;
    PyObject *array = new_array('l', 1, &occupied, (void **)&cells);
    if (array) list_cells(grid, cells);
    free(grid);
    return array;
}

static PyObject *agents_learned_point_grid_count_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array points, edges;
    if (!expect_arguments("count_points", count, 2, 2) || !open_array(arguments[0], 'f', &points)) return NULL;
    if (!open_array(arguments[1], 'f', &edges)) {
        close_array(&points);
        return NULL;
    }
    PyObject *cells = count_checked(&points, &edges);
    close_arrays(2, (Array *[]){&points, &edges});
    return cells;
}

Functions agents_learned_point_grid = {
    FUNCTION(agents_learned_point_grid_count_points),
    END_OF_FUNCTIONS,
};
