/* Twin of profile_search.py: the whole search of one speed profile. */
#include <stdlib.h>
#include <string.h>

#include "path_overlap.h"

enum { SETTLING_LAYERS = 2, PLANNED_BRAKING = 2, MOST_CELLS = 1 << 24 };

FIELDS(PROBLEM, "cells", "limits", "goals", "blocked", "must_move", "ends_standing", "wait_penalty", "lattice",
       "blocked_after", "start_s", "speed", "lattice_s");
enum { CELLS, LIMITS, GOALS, BLOCKED, MUST_MOVE, ENDS_STANDING, WAIT_PENALTY, LATTICE, BLOCKED_AFTER, START_S, SPEED,
       LATTICE_S };
FIELDS(LATTICE_NUMBERS, "step_s", "speed_step", "cell_m", "has_exact_start");
FIELDS(LATTICE_COUNTS, "top", "samples");
FIELDS(TRANSITIONS, "before", "advance", "back", "is_illegal", "effort", "reach");
FIELDS(GOAL, "start", "stop");
FIELDS(PROFILE, "s", "speed", "reaches_goal", "step_s");
static Import SPEED_PROFILE = {"mdrive_sumo.planning.speed_profile", "SpeedProfile", 0};
static Import FINE_LATTICE = {"mdrive_sumo.planning.speed_lattice", "FINE", 0};

/* Arrays of a problem and its transitions, by their place in `arrays`. */
enum { OPEN_LIMITS, OPEN_BLOCKED, OPEN_MUST_MOVE, OPEN_AFTER, OPEN_BEFORE, OPEN_ADVANCE, OPEN_BACK, OPEN_ILLEGAL,
       OPEN_EFFORT, MOST_ARRAYS };

/* Cells from `low` up to before `high`; none if low >= high. */
typedef struct {
    Py_ssize_t low, high;
} Range;

typedef struct {
    Py_ssize_t first, count; /* number of the first cell, number of cells */
    double *cost;            /* [speeds][stride], infinity where a state cannot be reached */
    Range *ranges;           /* [speeds] cells outside cannot be reached */
} Layer;

typedef struct {
    Py_ssize_t first, count;
    size_t at; /* of its moves in `choices`, [speeds][count] */
} Choice;

typedef struct {
    Array arrays[MOST_ARRAYS];
    int open;
    Py_ssize_t cells, layers, samples, speeds, moves, back_moves, reach, goal_first, goal_end, goal_speeds, first_limit;
    Py_ssize_t blocked_rows, stride;
    double step_s, speed_step, cell_m, wait, start_s, speed, lattice_s;
    bool has_exact_start, ends_standing;
    double *buffers, *row; /* two layers; what one row takes */
    Range *ranges;         /* of two layers */
    unsigned char *mask, *choices;
    size_t choices_size, choices_used;
    Choice *history;
    Py_ssize_t advanced;
} Search;

typedef struct {
    Py_ssize_t speed, cell;
} State;

static const unsigned char *bytes(const Array *array) { return array->data; }

static bool open_next(Search *search, PyObject *object, Fields *fields, int field, char kind, int dimensions) {
    PyObject *value = get_field(object, fields, field);
    if (!value) return false;
    Array *array = search->arrays + search->open;
    bool is_open = open_array(value, kind, array);
    Py_DecRef(value);
    if (!is_open) return false;
    search->open++;
    if (array->dimensions == dimensions) return true;
    PyErr_SetString(PyExc_ValueError, "a speed profile problem has an array of the wrong shape");
    return false;
}

/* As slice.indices, for goals without a step: None or an integer. */
static bool read_bound(PyObject *goals, int field, Py_ssize_t missing, Py_ssize_t cells, Py_ssize_t *bound) {
    PyObject *value = get_field(goals, &GOAL, field);
    if (!value) return false;
    bool is_integer = true;
    *bound = missing;
    if (value != Py_None) is_integer = read_integer(value, bound);
    Py_DecRef(value);
    if (*bound < 0) *bound = *bound + cells < 0 ? 0 : *bound + cells;
    if (*bound > cells) *bound = cells;
    return is_integer;
}

static bool read_goals(Search *search, PyObject *problem) {
    PyObject *goals = get_field(problem, &PROBLEM, GOALS);
    bool is_read = goals && read_bound(goals, 0, 0, search->cells, &search->goal_first) &&
                   read_bound(goals, 1, search->cells, search->cells, &search->goal_end);
    if (goals) Py_DecRef(goals);
    return is_read;
}

static bool read_lattice(Search *search, PyObject *problem) {
    PyObject *lattice = get_field(problem, &PROBLEM, LATTICE), *fine = find_import(&FINE_LATTICE);
    double numbers[4], fine_cell_m, wait_penalty;
    bool is_read = lattice && fine && read_fields(lattice, &LATTICE_NUMBERS, numbers) &&
                   read_integer_field(lattice, &LATTICE_COUNTS, 0, &search->speeds) &&
                   read_integer_field(lattice, &LATTICE_COUNTS, 1, &search->samples) &&
                   read_number_field(fine, &LATTICE_NUMBERS, 2, &fine_cell_m) &&
                   read_number_field(problem, &PROBLEM, WAIT_PENALTY, &wait_penalty);
    if (lattice) Py_DecRef(lattice);
    if (!is_read) return false;
    search->step_s = numbers[0], search->speed_step = numbers[1], search->speeds++;
    search->cell_m = numbers[2], search->has_exact_start = numbers[3] != 0.0;
    search->wait = wait_penalty * (search->cell_m / fine_cell_m);
    return true;
}

static bool check_transitions(const Search *search) {
    const Array *before = search->arrays + OPEN_BEFORE, *advance = search->arrays + OPEN_ADVANCE;
    const Array *back = search->arrays + OPEN_BACK, *illegal = search->arrays + OPEN_ILLEGAL;
    Py_ssize_t states = search->moves * search->speeds;
    if (before->count != states || advance->count != states || illegal->count != states) return false;
    if (before->shape[1] != search->speeds || search->arrays[OPEN_EFFORT].count != search->moves) return false;
    if (back->shape[0] != 1 && back->shape[0] != search->moves) return false;
    if (back->shape[1] != search->samples || back->shape[2] != search->speeds || search->moves > 255) return false;
    for (Py_ssize_t i = 0; i < states; i++) {
        int64_t index = integers(before)[i], cells = integers(advance)[i];
        if (index < 0 || index >= search->speeds || cells < 0 || cells > search->reach) return false;
    }
    for (Py_ssize_t i = 0; i < back->count; i++)
        if (integers(back)[i] < 0 || integers(back)[i] > search->reach) return false;
    return true;
}

static bool check_problem(const Search *search) {
    const Array *blocked = search->arrays + OPEN_BLOCKED, *after = search->arrays + OPEN_AFTER;
    return search->cells <= MOST_CELLS && search->speeds > 0 && search->samples > 0 && search->reach >= 0 &&
           blocked->shape[1] == search->cells && (!after->count || after->count == search->cells) &&
           isfinite(search->speed) && search->first_limit >= -1;
}

static bool read_search(Search *search, PyObject *problem, PyObject *transitions) {
    double flag;
    if (!open_next(search, problem, &PROBLEM, LIMITS, 'l', 1) || !open_next(search, problem, &PROBLEM, BLOCKED, '?', 2) ||
        !open_next(search, problem, &PROBLEM, MUST_MOVE, '?', 1) ||
        !open_next(search, problem, &PROBLEM, BLOCKED_AFTER, '?', 1) ||
        !open_next(search, transitions, &TRANSITIONS, 0, 'l', 2) ||
        !open_next(search, transitions, &TRANSITIONS, 1, 'l', 2) ||
        !open_next(search, transitions, &TRANSITIONS, 2, 'l', 3) ||
        !open_next(search, transitions, &TRANSITIONS, 3, '?', 2) ||
        !open_next(search, transitions, &TRANSITIONS, 4, 'd', 3) ||
        !read_integer_field(transitions, &TRANSITIONS, 5, &search->reach) || !read_lattice(search, problem) ||
        !read_number_field(problem, &PROBLEM, ENDS_STANDING, &flag) ||
        !read_number_field(problem, &PROBLEM, START_S, &search->start_s) ||
        !read_number_field(problem, &PROBLEM, SPEED, &search->speed) ||
        !read_number_field(problem, &PROBLEM, LATTICE_S, &search->lattice_s))
        return false;
    search->cells = search->arrays[OPEN_LIMITS].count, search->layers = search->arrays[OPEN_MUST_MOVE].count;
    search->blocked_rows = search->arrays[OPEN_BLOCKED].shape[0];
    search->moves = search->arrays[OPEN_BEFORE].shape[0], search->back_moves = search->arrays[OPEN_BACK].shape[0];
    search->ends_standing = flag != 0.0;
    search->goal_speeds = search->ends_standing ? 1 : search->speeds;
    double index = round_even(search->speed / search->speed_step);
    search->first_limit = isfinite(index) && fabs(index) < 1e9 ? (Py_ssize_t)index - 1 : -2;
    if (check_problem(search) && check_transitions(search)) return read_goals(search, problem);
    PyErr_SetString(PyExc_ValueError, "expected a speed profile problem whose arrays and numbers fit together");
    return false;
}

static bool allocate(Search *search) {
    search->stride = search->cells > 0 ? search->cells : 1;
    size_t states = (size_t)search->speeds * (size_t)search->stride;
    search->buffers = malloc(2 * states * sizeof *search->buffers);
    search->row = malloc(2 * (size_t)search->stride * sizeof *search->row);
    search->ranges = calloc(2 * (size_t)search->speeds, sizeof *search->ranges);
    search->mask = malloc((size_t)search->stride);
    search->history = malloc((size_t)(search->layers + 1) * sizeof *search->history);
    if (search->buffers && search->row && search->ranges && search->mask && search->history) return true;
    PyErr_NoMemory();
    return false;
}

static void release(Search *search) {
    for (int i = 0; i < search->open; i++) close_array(search->arrays + i);
    free(search->buffers), free(search->row), free(search->ranges), free(search->mask);
    free(search->history), free(search->choices);
}

static bool find_cheapest(const Search *search, const Layer *layer, Py_ssize_t first, Py_ssize_t end, Py_ssize_t speeds,
                          State *state) {
    Py_ssize_t low = first > layer->first ? first - layer->first : 0, layer_end = layer->first + layer->count;
    Py_ssize_t high = (end < layer_end ? end : layer_end) - layer->first;
    double least = INFINITY;
    for (Py_ssize_t speed = 0; speed < speeds; speed++)
        for (Py_ssize_t cell = low; cell < high; cell++) {
            double cost = layer->cost[speed * search->stride + cell];
            if (cost < least) least = cost, *state = (State){speed, cell + layer->first};
        }
    return least < INFINITY;
}

static bool find_goal(const Search *search, const Layer *layer, State *state) {
    return find_cheapest(search, layer, search->goal_first, search->goal_end, search->goal_speeds, state);
}

static void widen(Range *range, Range other) {
    if (other.low < range->low) range->low = other.low;
    if (other.high > range->high) range->high = other.high;
}

/* Whether a cell can be reached; the layer loses unreachable cells at both ends. */
static bool trim(const Search *search, Layer *layer) {
    Range all = {layer->count, 0};
    for (Py_ssize_t speed = 0; speed < search->speeds; speed++) {
        const double *row = layer->cost + speed * search->stride;
        Range *range = layer->ranges + speed;
        while (range->low < range->high && !isfinite(row[range->low])) range->low++;
        while (range->low < range->high && !isfinite(row[range->high - 1])) range->high--;
        if (range->low < range->high) widen(&all, *range);
    }
    if (all.low >= all.high) return false;
    for (Py_ssize_t speed = 0; speed < search->speeds; speed++)
        layer->ranges[speed].low -= all.low, layer->ranges[speed].high -= all.low;
    layer->first += all.low, layer->cost += all.low, layer->count = all.high - all.low;
    return true;
}

static void merge_mask(unsigned char *restrict mask, const unsigned char *restrict row, Py_ssize_t count) {
    for (Py_ssize_t cell = 0; cell < count; cell++) mask[cell] |= row[cell];
}

/* Mark in `mask` which of `count` cells from `first` on cannot be entered by a move at this speed. Cells behind the
   first one are blocked as that one is. */
static bool mark_blocked(Search *search, Py_ssize_t number, Py_ssize_t move, Py_ssize_t speed, Py_ssize_t first,
                         Py_ssize_t count, const bool *is_sample_free) {
    const int64_t *back = integers(search->arrays + OPEN_BACK) + move * search->samples * search->speeds + speed;
    bool is_marked = false;
    for (Py_ssize_t sample = 0; sample < search->samples; sample++) {
        if (is_sample_free[sample]) continue;
        const unsigned char *row = bytes(search->arrays + OPEN_BLOCKED) + (number * search->samples + sample) * search->cells;
        Py_ssize_t behind = (Py_ssize_t)back[sample * search->speeds] - first;
        unsigned char *mask = search->mask;
        if (!is_marked) memset(mask, 0, (size_t)count);
        is_marked = true;
        Py_ssize_t start = behind < 0 ? 0 : behind < count ? behind : count;
        if (row[0]) memset(mask, 1, (size_t)start);
        merge_mask(mask + start, row + start - behind, count - start);
    }
    return is_marked;
}

static bool is_free(const unsigned char *row, Py_ssize_t low, Py_ssize_t high) {
    return low >= high || !memchr(row + low, 1, (size_t)(high - low));
}

/* Samples of a layer's step at which nothing is blocked within reach. */
static void find_free_samples(const Search *search, Py_ssize_t number, Py_ssize_t first, Py_ssize_t count, bool *is_sample_free) {
    for (Py_ssize_t sample = 0; sample < search->samples; sample++) {
        Py_ssize_t row = number * search->samples + sample, low = first > search->reach ? first - search->reach : 0;
        is_sample_free[sample] =
            row >= search->blocked_rows ||
            is_free(bytes(search->arrays + OPEN_BLOCKED) + row * search->cells, low, first + count);
    }
}

/* Place for the moves of a layer. */
static unsigned char *reserve_choices(Search *search, size_t size) {
    if (search->choices_used + size > search->choices_size) {
        size_t larger = 2 * search->choices_size + size;
        unsigned char *choices = realloc(search->choices, larger);
        if (!choices) {
            PyErr_NoMemory();
            return NULL;
        }
        search->choices = choices, search->choices_size = larger;
    }
    unsigned char *place = search->choices + search->choices_used;
    search->choices_used += size;
    return place;
}

/* Take over the options of one move (count) where they are cheaper. */
static void take_cheaper(const double *restrict from, double effort, Py_ssize_t count, double move, double *restrict cost,
                         double *restrict choice) {
    for (Py_ssize_t cell = 0; cell < count; cell++) {
        double option = from[cell] + effort;
        choice[cell] = option < cost[cell] ? move : choice[cell];
        cost[cell] = option < cost[cell] ? option : cost[cell];
    }
}

/* Where the moves from cells `from` end that pass `ahead` cells. */
static Range shift_range(Range from, Py_ssize_t ahead, Py_ssize_t count) {
    Py_ssize_t high = from.high + ahead;
    return from.low < from.high ? (Range){from.low + ahead, high < count ? high : count} : (Range){count, 0};
}

/* The costs of all moves that end at one speed; the best move of each cell that can be reached. */
static void advance_speed(Search *search, const Layer *layer, Py_ssize_t number, Py_ssize_t speed, const bool *is_sample_free,
                          Layer *after, unsigned char *choice) {
    double *option = search->row, *best = search->row + search->stride, *cost = after->cost + speed * search->stride;
    Range to = {after->count, 0};
    for (Py_ssize_t move = 0; move < search->moves; move++) {
        Py_ssize_t state = move * search->speeds + speed, before = (Py_ssize_t)integers(search->arrays + OPEN_BEFORE)[state];
        if (bytes(search->arrays + OPEN_ILLEGAL)[state]) continue;
        Py_ssize_t ahead = (Py_ssize_t)integers(search->arrays + OPEN_ADVANCE)[state];
        Range range = shift_range(layer->ranges[before], ahead, after->count);
        if (range.low < range.high) widen(&to, range);
    }
    for (Py_ssize_t cell = 0; cell < after->count; cell++) cost[cell] = INFINITY;
    after->ranges[speed] = to;
    if (to.low >= to.high) return;
    const unsigned char *mask = search->mask; /* of cell to.low and the following */
    Py_ssize_t first = layer->first + to.low, width = to.high - to.low;
    for (Py_ssize_t cell = to.low; cell < to.high; cell++) best[cell] = 0.0;
    for (Py_ssize_t move = 0; move < search->moves; move++) {
        Py_ssize_t state = move * search->speeds + speed, before = (Py_ssize_t)integers(search->arrays + OPEN_BEFORE)[state];
        if (bytes(search->arrays + OPEN_ILLEGAL)[state]) continue;
        Py_ssize_t ahead = (Py_ssize_t)integers(search->arrays + OPEN_ADVANCE)[state];
        Range range = shift_range(layer->ranges[before], ahead, after->count);
        if (range.low >= range.high) continue;
        const double *from = layer->cost + before * search->stride + range.low - ahead;
        if (search->back_moves > 1 && mark_blocked(search, number, move, speed, first, width, is_sample_free)) {
            for (Py_ssize_t cell = range.low; cell < range.high; cell++)
                option[cell] = mask[cell - to.low] ? INFINITY : from[cell - range.low];
            from = option + range.low;
        }
        take_cheaper(from, doubles(search->arrays + OPEN_EFFORT)[move], range.high - range.low, (double)move,
                     cost + range.low, best + range.low);
    }
    if (search->back_moves == 1 && mark_blocked(search, number, 0, speed, first, width, is_sample_free))
        for (Py_ssize_t cell = to.low; cell < to.high; cell++) cost[cell] = mask[cell - to.low] ? INFINITY : cost[cell];
    for (Py_ssize_t cell = to.low; cell < to.high; cell++) choice[cell] = (unsigned char)best[cell];
}

/* Forbid standing too long, and speeds above the limit; a car that is too fast may reach the limit gently. */
static void forbid(const Search *search, Layer *layer, Py_ssize_t number) {
    const int64_t *limits = integers(search->arrays + OPEN_LIMITS) + layer->first;
    Py_ssize_t count = layer->count, gentle = search->first_limit - number;
    for (Py_ssize_t cell = 0; cell < count; cell++)
        search->row[cell] = search->wait * (double)(search->cells - 1 - layer->first - cell);
    for (Py_ssize_t speed = 0; speed < search->speeds; speed++) {
        double *restrict row = layer->cost + speed * search->stride;
        const double *restrict wait = search->row;
        bool is_forbidden = !speed && bytes(search->arrays + OPEN_MUST_MOVE)[number];
        Range range = layer->ranges[speed];
        for (Py_ssize_t cell = range.low; cell < range.high; cell++)
            row[cell] = is_forbidden ? INFINITY : row[cell] + wait[cell];
        if (speed <= gentle) continue;
        for (Py_ssize_t cell = range.low; cell < range.high; cell++)
            if (speed > limits[cell]) row[cell] = INFINITY;
    }
}

static bool advance(Search *search, const Layer *layer, Py_ssize_t number, Layer *after) {
    Py_ssize_t end = layer->first + layer->count + search->reach;
    Py_ssize_t count = (end < search->cells ? end : search->cells) - layer->first;
    after->first = layer->first, after->count = count > 0 ? count : 0;
    size_t at = search->choices_used;
    unsigned char *choices = reserve_choices(search, (size_t)(search->speeds * after->count) + 1);
    bool *is_sample_free = malloc((size_t)search->samples * sizeof *is_sample_free);
    if (!choices || !is_sample_free) {
        free(is_sample_free);
        if (choices) PyErr_NoMemory();
        return false;
    }
    find_free_samples(search, number, after->first, after->count, is_sample_free);
    for (Py_ssize_t speed = 0; speed < search->speeds; speed++)
        advance_speed(search, layer, number, speed, is_sample_free, after, choices + speed * after->count);
    free(is_sample_free);
    search->history[search->advanced++] = (Choice){after->first, after->count, at};
    forbid(search, after, number);
    return true;
}

static Py_ssize_t find_settled_layer(const Search *search) {
    if (!search->has_exact_start || search->ends_standing || !search->blocked_rows) return search->layers;
    const unsigned char *blocked = bytes(search->arrays + OPEN_BLOCKED);
    const unsigned char *last = blocked + (search->blocked_rows - 1) * search->cells;
    for (Py_ssize_t row = search->blocked_rows - 2; row >= 0; row--)
        if (memcmp(blocked + row * search->cells, last, (size_t)search->cells))
            return row / search->samples + 1 + SETTLING_LAYERS;
    return SETTLING_LAYERS;
}

/* Whether the furthest cell is the same in two layers, and a car can stand there or in the cell before. */
static bool is_stuck(Py_ssize_t end_before, const Layer *after) {
    if (end_before != after->first + after->count) return false;
    return isfinite(after->cost[after->count - 1]) || (after->count > 1 && isfinite(after->cost[after->count - 2]));
}

/* Forbid states from which a car cannot stop before a cell that stays blocked. */
static void forbid_unstoppable(const Search *search, Layer *layer) {
    const unsigned char *blocked = bytes(search->arrays + OPEN_AFTER);
    for (Py_ssize_t speed = 0; speed < search->speeds; speed++) {
        Py_ssize_t stop = (speed * speed + PLANNED_BRAKING - 1) / PLANNED_BRAKING;
        for (Py_ssize_t cell = 0; cell < layer->count; cell++) {
            Py_ssize_t first = layer->first + cell, end = first + stop + 1;
            if (!is_free(blocked, first, end < search->cells ? end : search->cells))
                layer->cost[speed * search->stride + cell] = INFINITY;
        }
    }
}

static PyObject *trace_back(const Search *search, State state, bool reaches_goal) {
    Py_ssize_t points = search->advanced + 1;
    double *s, *speed;
    PyObject *stations = new_doubles(1, &points, &s);
    PyObject *speeds = stations ? new_doubles(1, &points, &speed) : NULL;
    for (Py_ssize_t k = points - 1; speeds; k--) {
        s[k] = search->lattice_s + (double)state.cell * search->cell_m;
        speed[k] = (double)state.speed * search->speed_step;
        if (!k) break;
        Choice choice = search->history[k - 1];
        Py_ssize_t move = search->choices[choice.at + (size_t)(state.speed * choice.count + state.cell - choice.first)];
        Py_ssize_t row = move * search->speeds + state.speed;
        state.speed = (Py_ssize_t)integers(search->arrays + OPEN_BEFORE)[row];
        state.cell -= (Py_ssize_t)integers(search->arrays + OPEN_ADVANCE)[row];
    }
    if (speeds && search->has_exact_start) s[0] = search->start_s, speed[0] = search->speed;
    if (!speeds) {
        if (stations) Py_DecRef(stations);
        return NULL;
    }
    PyObject *values[] = {stations, speeds, PyBool_FromLong(reaches_goal), PyFloat_FromDouble(search->step_s)};
    return build_instance(&SPEED_PROFILE, &PROFILE, values);
}

static PyObject *run_search(Search *search) {
    size_t states = (size_t)search->speeds * (size_t)search->stride;
    Layer layer = {0, 1, search->buffers, search->ranges};
    for (size_t i = 0; i < states; i++) layer.cost[i] = INFINITY;
    Py_ssize_t start = search->first_limit + 1 < search->speeds ? search->first_limit + 1 : search->speeds - 1;
    layer.cost[start * search->stride] = 0.0, layer.ranges[start].high = 1;
    Py_ssize_t settled_layer = find_settled_layer(search);
    State state;
    for (Py_ssize_t number = 0; number < search->layers; number++) {
        if (find_goal(search, &layer, &state)) return trace_back(search, state, true);
        Py_ssize_t end_before = layer.first + layer.count;
        bool is_second = number % 2 == 0;
        Layer after = {0, 0, search->buffers + (is_second ? states : 0), search->ranges + (is_second ? search->speeds : 0)};
        if (!advance(search, &layer, number, &after)) return NULL;
        if (!trim(search, &after)) return new_reference(Py_None);
        layer = after;
        if (number > settled_layer && is_stuck(end_before, &layer)) {
            for (Py_ssize_t speed = 1; speed < search->speeds; speed++)
                for (Py_ssize_t cell = 0; cell < layer.count; cell++) layer.cost[speed * search->stride + cell] = INFINITY;
            break;
        }
    }
    if (find_goal(search, &layer, &state)) return trace_back(search, state, true);
    if (search->arrays[OPEN_AFTER].count) forbid_unstoppable(search, &layer);
    if (!trim(search, &layer)) return new_reference(Py_None);
    Py_ssize_t end = layer.first + layer.count;
    find_cheapest(search, &layer, end - 1, end, search->speeds, &state);
    return trace_back(search, state, false);
}

static PyObject *planning_profile_search_search_profile(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("search_profile", count, 2, 2)) return NULL;
    Search search = {0};
    PyObject *result = NULL;
    if (read_search(&search, arguments[0], arguments[1]) && allocate(&search)) result = run_search(&search);
    release(&search);
    return result;
}

Functions planning_profile_search = {
    FUNCTION(planning_profile_search_search_profile),
    END_OF_FUNCTIONS,
};
