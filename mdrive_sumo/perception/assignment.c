/* Twins of assignment.py. */
#include "assignment.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double IMPOSSIBLE = 1e6;

/* The matrices of `assign`, and where its search works. */
typedef struct {
    const double *cost;
    const unsigned char *possible;
    const int64_t *block;
    Py_ssize_t rows, columns;
    unsigned char *chosen, *contested; /* [rows][columns] */
    /* The contested part of a block: its rows and columns, turned round if it has more rows than columns. */
    Py_ssize_t *row, *column, height, width;
    bool is_turned;
    /* Of solve_assignment; one for each column of the part, or of its rows, and one more. */
    double *by_row, *by_column, *least;
    Py_ssize_t *row_of, *before;
    bool *done;
} Search;

/* Row and column are those of the part as it is turned, from 0. */
static Py_ssize_t find_place(const Search *search, Py_ssize_t row, Py_ssize_t column) {
    return search->is_turned ? search->row[column] * search->columns + search->column[row]
                             : search->row[row] * search->columns + search->column[column];
}

static bool augment(Search *search) {
    Py_ssize_t width = search->width, column = 0;
    Py_ssize_t *row_of = search->row_of;
    for (Py_ssize_t i = 0; i <= width; i++) search->least[i] = INFINITY, search->before[i] = 0, search->done[i] = false;
    do {
        search->done[column] = true;
        Py_ssize_t row = row_of[column], following = 0;
        double best = INFINITY;
        for (Py_ssize_t other = 1; other <= width; other++) {
            if (search->done[other]) continue;
            Py_ssize_t place = find_place(search, row - 1, other - 1);
            double cost = search->contested[place] ? search->cost[place] : IMPOSSIBLE;
            double reduced = cost - search->by_row[row] - search->by_column[other];
            if (reduced < search->least[other]) search->least[other] = reduced, search->before[other] = column;
            if (search->least[other] < best) best = search->least[other], following = other;
        }
        if (!following) {
            PyErr_SetString(PyExc_ValueError, "expected finite costs of assignments, found NaN or infinity");
            return false;
        }
        for (Py_ssize_t other = 0; other <= width; other++) {
            if (search->done[other]) {
                search->by_row[row_of[other]] += best;
                search->by_column[other] -= best;
            } else {
                search->least[other] -= best;
            }
        }
        column = following;
    } while (row_of[column]);
    while (column) {
        row_of[column] = row_of[search->before[column]];
        column = search->before[column];
    }
    return true;
}

static bool solve_assignment(Search *search) {
    search->is_turned = search->height > search->width;
    if (search->is_turned) {
        Py_ssize_t height = search->height;
        search->height = search->width, search->width = height;
    }
    for (Py_ssize_t i = 0; i <= search->height; i++) search->by_row[i] = 0.0;
    for (Py_ssize_t i = 0; i <= search->width; i++) search->by_column[i] = 0.0, search->row_of[i] = 0;
    for (Py_ssize_t row = 1; row <= search->height; row++) {
        search->row_of[0] = row;
        if (!augment(search)) return false;
    }
    for (Py_ssize_t column = 1; column <= search->width; column++) {
        if (!search->row_of[column]) continue;
        Py_ssize_t place = find_place(search, search->row_of[column] - 1, column - 1);
        search->chosen[place] |= search->contested[place];
    }
    return true;
}

/* Of the columns from first to end. */
static bool assign_block(Search *search, Py_ssize_t first, Py_ssize_t end) {
    const unsigned char *possible = search->possible;
    search->height = search->width = 0;
    for (Py_ssize_t i = 0; i < search->rows; i++) {
        Py_ssize_t in_row = 0;
        for (Py_ssize_t j = first; j < end; j++) in_row += possible[i * search->columns + j];
        for (Py_ssize_t j = first; j < end; j++) {
            Py_ssize_t place = i * search->columns + j, in_column = 0;
            if (!possible[place]) continue;
            for (Py_ssize_t k = 0; k < search->rows; k++) in_column += possible[k * search->columns + j];
            search->chosen[place] = in_row == 1 && in_column == 1;
            search->contested[place] = !search->chosen[place];
        }
    }
    for (Py_ssize_t j = first; j < end; j++)
        for (Py_ssize_t i = 0; i < search->rows; i++)
            if (search->contested[i * search->columns + j]) {
                search->column[search->width++] = j;
                break;
            }
    for (Py_ssize_t i = 0; i < search->rows; i++)
        for (Py_ssize_t j = first; j < end; j++)
            if (search->contested[i * search->columns + j]) {
                search->row[search->height++] = i;
                break;
            }
    return !search->width || solve_assignment(search);
}

static void list_chosen(const Search *search, Pairs *pairs) {
    for (Py_ssize_t i = 0; i < search->rows * search->columns; i++)
        if (search->chosen[i]) {
            pairs->row[pairs->count] = i / search->columns;
            pairs->column[pairs->count++] = i % search->columns;
        }
}

void free_pairs(Pairs *pairs) { free(pairs->row); }

bool assign_pairs(Pairs *pairs) {
    Search search = {.cost = pairs->cost,
                     .possible = pairs->possible,
                     .block = pairs->block,
                     .rows = pairs->rows,
                     .columns = pairs->columns};
    size_t all = (size_t)(search.rows * search.columns), lines = (size_t)(search.rows + search.columns + 1);
    pairs->count = 0;
    pairs->row = malloc(2 * lines * sizeof *pairs->row);
    char *memory = calloc(1, 2 * all + lines * (4 * sizeof(Py_ssize_t) + 3 * sizeof(double) + sizeof(bool)));
    bool is_solved = memory && pairs->row;
    if (is_solved) {
        pairs->column = pairs->row + lines;
        search.by_row = (double *)memory, search.by_column = search.by_row + lines, search.least = search.by_column + lines;
        search.row_of = (Py_ssize_t *)(search.least + lines), search.before = search.row_of + lines;
        search.row = search.before + lines, search.column = search.row + lines;
        search.done = (bool *)(search.column + lines);
        search.chosen = (unsigned char *)(search.done + lines), search.contested = search.chosen + all;
    } else {
        PyErr_NoMemory();
    }
    for (Py_ssize_t first = 0, end; is_solved && first < search.columns; first = end) {
        for (end = first + 1; end < search.columns && search.block[end] == search.block[first];) end++;
        is_solved = assign_block(&search, first, end);
    }
    if (is_solved) list_chosen(&search, pairs);
    else free_pairs(pairs);
    free(memory);
    return is_solved;
}

static PyObject *build_pairs(Pairs *pairs) {
    if (!assign_pairs(pairs)) return NULL;
    void *rows = NULL, *columns = NULL;
    PyObject *first = new_array('l', 1, &pairs->count, &rows);
    PyObject *second = first ? new_array('l', 1, &pairs->count, &columns) : NULL;
    if (second && pairs->count) {
        memcpy(rows, pairs->row, (size_t)pairs->count * sizeof *pairs->row);
        memcpy(columns, pairs->column, (size_t)pairs->count * sizeof *pairs->column);
    }
    free_pairs(pairs);
    return pack(2, first, second);
}

static PyObject *perception_assignment_assign(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array cost, possible, blocks;
    if (!expect_arguments("assign", count, 3, 3) || !open_doubles(arguments[0], 2, &cost)) return NULL;
    PyObject *result = NULL;
    if (open_array(arguments[1], '?', &possible)) {
        if (open_array(arguments[2], 'l', &blocks)) {
            Pairs pairs = {.cost = cost.data,
                           .possible = possible.data,
                           .block = blocks.data,
                           .rows = cost.shape[0],
                           .columns = cost.shape[1]};
            if (possible.dimensions == 2 && possible.shape[0] == pairs.rows && possible.shape[1] == pairs.columns &&
                blocks.count == pairs.columns)
                result = build_pairs(&pairs);
            else PyErr_SetString(PyExc_ValueError, "expected costs, possible pairs and blocks of one shape");
            close_array(&blocks);
        }
        close_array(&possible);
    }
    close_array(&cost);
    return result;
}

Functions perception_assignment = {
    FUNCTION(perception_assignment_assign),
    END_OF_FUNCTIONS,
};
