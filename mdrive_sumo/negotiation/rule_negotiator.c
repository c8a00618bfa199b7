/* Twin of rule_negotiator.py. */
#include <stdlib.h>

#include "../planning/path_overlap.h"

FIELDS(MEMBER, "x", "y", "yaw", "desired", "id");
FIELDS(PARAMETERS, "max_lateral_m", "same_direction_cos");

/* A member of a negotiation; `id` is a reference of its own. */
typedef struct {
    double x, y, yaw;
    Array desired;
    PyObject *id;
} Member;

static bool open_member(PyObject *object, Member *member) {
    if (!read_number_field(object, &MEMBER, 0, &member->x) || !read_number_field(object, &MEMBER, 1, &member->y) ||
        !read_number_field(object, &MEMBER, 2, &member->yaw) || !open_field(object, &MEMBER, 3, 'd', 2, &member->desired))
        return false;
    member->id = get_field(object, &MEMBER, 4);
    if (member->id && member->desired.shape[1] == 2) return true;
    if (member->id) {
        Py_DecRef(member->id);
        PyErr_SetString(PyExc_ValueError, "expected desired points (K, 2)");
    }
    close_array(&member->desired);
    return false;
}

/* A point of the line from a member's position through its desired points. */
static Point get_point(const Member *member, Py_ssize_t i) {
    return i ? ((const Point *)member->desired.data)[i - 1] : (Point){member->x, member->y};
}

static double measure(Point a, Point b) { return portable_hypot(a.x - b.x, a.y - b.y); }

/* How many parts conflict_graph.densify makes of each step; NaN if a point is none. */
static double count_parts(const Member *member, double max_step_m) {
    double longest = 0.0;
    for (Py_ssize_t i = 0; i < member->desired.shape[0]; i++) {
        double step = measure(get_point(member, i + 1), get_point(member, i));
        if (isnan(step)) return NAN;
        longest = greatest(step, longest);
    }
    return longest > max_step_m ? ceil(longest / max_step_m) : 1.0;
}

/* The least distance of a point from the densified line. */
static double measure_lateral(const Member *member, double parts, Point point) {
    double gap = INFINITY;
    Py_ssize_t steps = member->desired.shape[0];
    for (Py_ssize_t i = 0; i < steps; i++) {
        Point from = get_point(member, i), to = get_point(member, i + 1);
        for (double part = 0.0; part < parts; part += 1.0) {
            Point between = {from.x + part / parts * (to.x - from.x), from.y + part / parts * (to.y - from.y)};
            gap = least(measure(parts > 1.0 ? between : from, point), gap);
        }
    }
    return least(measure(get_point(member, steps), point), gap);
}

static bool leads(const Member *leader, const Member *follower, double parts, const double *parameters) {
    if (cos_sin(leader->yaw - follower->yaw).cos < parameters[1]) return false;
    CosSin direction = cos_sin(follower->yaw);
    double ahead = direction.cos * (leader->x - follower->x) + direction.sin * (leader->y - follower->y);
    return ahead > 0 && measure_lateral(follower, parts, (Point){leader->x, leader->y}) < parameters[0];
}

static PyObject *list_pairs(const Member *members, Py_ssize_t count, const double *parameters, double max_step_m) {
    PyObject *pairs = PyList_New(0);
    for (Py_ssize_t i = 0; pairs && i < count; i++) {
        double parts = count_parts(members + i, max_step_m);
        if (!(parts < 1e6) || !isfinite(cos_sin(members[i].yaw).cos)) {
            PyErr_SetString(PyExc_ValueError, "expected finite positions and headings of members");
            Py_DecRef(pairs), pairs = NULL;
        }
        for (Py_ssize_t j = 0; pairs && j < count; j++) {
            if (i == j || !leads(members + j, members + i, parts, parameters)) continue;
            PyObject *pair = pack(2, new_reference(members[j].id), new_reference(members[i].id));
            if (!pair || PyList_Append(pairs, pair)) Py_DecRef(pairs), pairs = NULL;
            if (pair) Py_DecRef(pair);
        }
    }
    return pairs;
}

static PyObject *negotiation_rule_negotiator_list_leader_pairs(PyObject *module, PyObject *const *arguments,
                                                               Py_ssize_t count) {
    double parameters[2], max_step_m;
    if (!expect_arguments("list_leader_pairs", count, 3, 3) || !read_fields(arguments[1], &PARAMETERS, parameters) ||
        !read_number(arguments[2], &max_step_m))
        return NULL;
    Py_ssize_t size = PyObject_Size(arguments[0]), opened = 0;
    if (size < 0) return NULL;
    Member *members = calloc((size_t)size + 1, sizeof *members);
    if (!members) return PyErr_NoMemory();
    for (; opened < size; opened++) {
        PyObject *member = PySequence_GetItem(arguments[0], opened);
        bool is_open = member && open_member(member, members + opened);
        if (member) Py_DecRef(member);
        if (!is_open) break;
    }
    PyObject *result = opened == size ? list_pairs(members, size, parameters, max_step_m) : NULL;
    for (Py_ssize_t i = 0; i < opened; i++) {
        close_array(&members[i].desired);
        Py_DecRef(members[i].id);
    }
    free(members);
    return result;
}

Functions negotiation_rule_negotiator = {
    FUNCTION(negotiation_rule_negotiator_list_leader_pairs),
    END_OF_FUNCTIONS,
};
