/* Twin of radio_medium.py: what becomes of each message at each receiver. */
#include "../../core/compiled/values.h"
#include "../../core/portable.h"
#include "link_class.h"
#include "packet_error.h"

/* Risks: `ChannelLoad` without its busy ratio. */
enum { COLLISION_PER_PACKET, COLLISION_PER_SECOND, BUSY, HALF_DUPLEX_PER_PACKET, HALF_DUPLEX_PER_SECOND, RISKS };
enum { POWER = RISKS, CURVES_ARRAY, CLASSES, ARRAYS };
enum { PATH_LOSS, BUSY_RECEIVER, HALF_DUPLEX, COLLISION, LOSSES };
/* Places in a `Transmission` and in a `AirBill`. */
enum { SENDER = 0, RECEIVERS = 2, LUCKS = 3, SHARE = 2, PACKETS = 3, SIZE = 4, COLLIDING = 5 };

typedef struct {
    Py_ssize_t n, total;
    const double *risks[RISKS], *power;
    const unsigned char *classes;
    ErrorCurves curves;
    double noise_dbm;
} Air;

static Py_ssize_t find_row(PyObject *columns, PyObject *name, Py_ssize_t n) {
    PyObject *column = PyDict_GetItemWithError(columns, name);
    Py_ssize_t row = -1;
    if (column && read_integer(column, &row) && row >= 0 && row < n) return row;
    if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected the name of a station");
    return -1;
}

/* Adds up what a receiver's luck has to survive, until it does not: the number of a loss, or LOSSES. */
static int find_cause(const Air *air, Py_ssize_t row, Py_ssize_t to, const double *bill, double luck) {
    Py_ssize_t place = row * air->n + to, heard = to * air->total + row;
    double error = interpolate_curve(&air->curves, air->power[heard] - air->noise_dbm, air->classes[heard]);
    double fade = -portable_log(1.0 - error > 1e-300 ? 1.0 - error : 1e-300), threshold = -portable_log(1.0 - luck);
    double share = bill[0], packets = bill[1], size = bill[2], colliding = bill[3];
    double risks[LOSSES] = {
        [PATH_LOSS] = share * fade,
        [BUSY_RECEIVER] = packets * air->risks[BUSY][place],
        [HALF_DUPLEX] = packets * air->risks[HALF_DUPLEX_PER_PACKET][place] +
                        size * air->risks[HALF_DUPLEX_PER_SECOND][place],
        [COLLISION] = colliding * air->risks[COLLISION_PER_PACKET][place] +
                      size * air->risks[COLLISION_PER_SECOND][place],
    };
    if (isnan(threshold) || !isfinite(air->power[heard] - air->noise_dbm)) return -1;
    double total = 0.0;
    int cause = 0;
    for (int i = 0; i < LOSSES; i++) {
        total += risks[i];
        cause += threshold >= total;
    }
    return cause;
}

static bool add_losses(const Air *air, PyObject *columns, PyObject *transmission, PyObject *bill, PyObject *names,
                       PyObject *losses) {
    PyObject *sender = PyTuple_GetItem(transmission, SENDER), *receivers = PyTuple_GetItem(transmission, RECEIVERS);
    PyObject *lucks = PyTuple_GetItem(transmission, LUCKS);
    double numbers[COLLIDING + 1 - SHARE];
    for (int i = SHARE; i <= COLLIDING; i++) {
        PyObject *number = PyTuple_GetItem(bill, i);
        if (!number || !read_number(number, &numbers[i - SHARE])) return false;
    }
    Py_ssize_t row = sender && lucks ? find_row(columns, sender, air->n) : -1;
    Py_ssize_t count = row < 0 ? -1 : PyTuple_Size(receivers);
    if (count < 0 || PyTuple_Size(lucks) != count) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected a random number of each receiver");
        return false;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *receiver = PyTuple_GetItem(receivers, i);
        double luck;
        Py_ssize_t to = find_row(columns, receiver, air->n);
        if (to < 0 || !read_number(PyTuple_GetItem(lucks, i), &luck)) return false;
        int cause = find_cause(air, row, to, numbers, luck);
        if (cause < 0) return refuse_numbers("find_losses");
        PyObject *name = cause < LOSSES ? PyTuple_GetItem(names, cause) : NULL;
        if (cause < LOSSES && (!name || PyDict_SetItem(losses, receiver, name))) return false;
    }
    return true;
}

static PyObject *list_losses(const Air *air, PyObject *const *arguments) {
    PyObject *transmissions = arguments[0], *bills = arguments[1], *result = PyList_New(0);
    Py_ssize_t count = PyList_Size(transmissions);
    bool is_valid = result && count >= 0 && PyList_Size(bills) == count;
    if (!is_valid && !PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected the bill of each transmission");
    for (Py_ssize_t i = 0; is_valid && i < count; i++) {
        PyObject *losses = PyDict_New();
        is_valid = losses && add_losses(air, arguments[2], PyList_GetItem(transmissions, i), PyList_GetItem(bills, i),
                                        arguments[3], losses) &&
                   !PyList_Append(result, losses);
        if (losses) Py_DecRef(losses);
    }
    if (is_valid) return result;
    if (result) Py_DecRef(result);
    return NULL;
}

static bool are_valid(const Array *arrays) {
    Py_ssize_t n = arrays[POWER].shape[0], total = arrays[POWER].shape[1];
    for (int i = 0; i < ARRAYS; i++)
        if (arrays[i].dimensions != 2) return false;
    for (int i = 0; i < RISKS; i++)
        if (arrays[i].shape[0] != n || arrays[i].shape[1] != n) return false;
    const unsigned char *classes = arrays[CLASSES].data;
    for (Py_ssize_t i = 0; i < arrays[CLASSES].count; i++)
        if (classes[i] > NLOSB) return false;
    const Array *curves = arrays + CURVES_ARRAY;
    return n <= total && arrays[CLASSES].shape[0] == n && arrays[CLASSES].shape[1] == total &&
           curves->shape[0] == CURVES && curves->shape[1] > 1 && curves->shape[1] < 1000;
}

static PyObject *v2x_radio_radio_medium_find_losses(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
    static const int places[ARRAYS] = {9, 10, 11, 12, 13, 4, 6, 5};
    double levels[2]; /* first of the curves, noise */
    if (!expect_arguments("find_losses", given, 14, 14) || !is_dict(arguments[2]) ||
        !read_numbers(arguments + 7, 2, levels))
        return NULL;
    Array arrays[ARRAYS];
    int opened = 0;
    while (opened < ARRAYS && open_array(arguments[places[opened]], opened == CLASSES ? 'B' : 'd', arrays + opened))
        opened++;
    PyObject *result = NULL;
    if (opened == ARRAYS && are_valid(arrays)) {
        Air air = {.n = arrays[POWER].shape[0], .total = arrays[POWER].shape[1], .power = doubles(arrays + POWER),
                   .classes = arrays[CLASSES].data, .noise_dbm = levels[1],
                   .curves = {doubles(arrays + CURVES_ARRAY), (int)arrays[CURVES_ARRAY].shape[1], levels[0]}};
        for (int i = 0; i < RISKS; i++) air.risks[i] = doubles(arrays + i);
        result = list_losses(&air, arguments);
    } else if (!PyErr_Occurred()) {
        PyErr_SetString(PyExc_ValueError, "expected what stations hear, error curves and risks");
    }
    while (opened--) close_array(arrays + opened);
    return result;
}

static Import MAKE_LINK = {"mdrive_sumo.v2x.radio.radio_medium", "make_link", 0};

/* The link of a level and a class, a new reference. */
static PyObject *find_link(PyObject *known, double level, unsigned char kind) {
    PyObject *key = PyLong_FromLongLong((long long)level * 4 + kind), *make = find_import(&MAKE_LINK);
    PyObject *link = key && make ? PyDict_GetItemWithError(known, key) : NULL;
    if (link) link = new_reference(link);
    else if (key && make && !PyErr_Occurred()) {
        link = PyObject_CallFunctionObjArgs(make, key, NULL);
        if (link && PyDict_SetItem(known, key, link)) {
            Py_DecRef(link);
            link = NULL;
        }
    }
    if (key) Py_DecRef(key);
    return link;
}

static bool add_links(PyObject *stations, Py_ssize_t i, const unsigned char *kinds, const double *levels,
                      PyObject *known, PyObject *links) {
    PyObject *others = PyDict_New();
    bool is_valid = others && !PyDict_SetItem(links, PyTuple_GetItem(stations, i), others);
    for (Py_ssize_t k = 0; is_valid && k < PyTuple_Size(stations); k++) {
        if (k == i) continue;
        double level = rint(levels[k]);
        PyObject *link = fabs(level) < 1e15 ? find_link(known, level, kinds[k]) : refuse_numbers("list_links");
        is_valid = link && !PyDict_SetItem(others, PyTuple_GetItem(stations, k), link);
        if (link) Py_DecRef(link);
    }
    if (others) Py_DecRef(others);
    return is_valid;
}

static PyObject *v2x_radio_radio_medium_list_links(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
    if (!expect_arguments("list_links", given, 4, 4) || !is_dict(arguments[3])) return NULL;
    Py_ssize_t n = PyTuple_Size(arguments[0]);
    Array classes, power;
    if (n < 0 || !open_array(arguments[1], 'B', &classes)) return NULL;
    if (!open_array(arguments[2], 'd', &power)) {
        close_array(&classes);
        return NULL;
    }
    PyObject *links = NULL;
    if (classes.dimensions == 2 && power.dimensions == 2 && classes.shape[0] == n && power.shape[0] == n &&
        classes.shape[1] >= n && power.shape[1] == classes.shape[1]) {
        links = PyDict_New();
        for (Py_ssize_t i = 0; links && i < n; i++)
            if (!add_links(arguments[0], i, (const unsigned char *)classes.data + i * classes.shape[1],
                           doubles(&power) + i * power.shape[1], arguments[3], links)) {
                Py_DecRef(links);
                links = NULL;
            }
    } else {
        PyErr_SetString(PyExc_ValueError, "expected what the stations hear");
    }
    close_array(&classes);
    close_array(&power);
    return links;
}

Functions v2x_radio_radio_medium = {
    FUNCTION(v2x_radio_radio_medium_find_losses),
    FUNCTION(v2x_radio_radio_medium_list_links),
    END_OF_FUNCTIONS,
};
