/* Loop: a closed loop of at most AMPI_LANES flights, and the memory that it takes. */
#include "objects.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    PyObject_HEAD
    ampi_loop loop;
    PyObject *program, *guidance;
    Py_buffer profiles;
    void *memory[4]; /* places, peaks and the two delays, as allocated */
} LoopObject;

enum { PLACES, PEAKS, NAVIGATION, ACTUATOR };

/* `rows` rows of lanes in zero, each at the begin of a cache line. */
static double *lanes(LoopObject *self, size_t which, size_t rows) {
    const size_t line = 64u;
    unsigned char *const memory = calloc(rows * sizeof(ampi_lanes) + line, 1u);
    self->memory[which] = memory;
    if (memory == NULL) {
        PyErr_NoMemory();
        return NULL;
    }
    return (double *)(void *)(memory + (line - (size_t)((uintptr_t)memory % line)) % line);
}

/* Rows of `n` flights over all lanes: those without a flight repeat the first. */
static void spread(const double *from, size_t rows, size_t n, ampi_lanes *to) {
    for (size_t row = 0; row < rows; row++) {
        for (size_t i = 0; i < AMPI_LANES; i++) {
            to[row][i] = from[row * n + (i < n ? i : 0u)];
        }
    }
}

static int delayed(LoopObject *self, size_t which, ampi_delay *delay, const double *back, size_t rows) {
    double longest = 0.0;
    for (size_t i = 0; i < AMPI_LANES; i++) {
        longest = back[i] > longest ? back[i] : longest;
    }
    if (!(longest < 1e6)) {
        PyErr_Format(PyExc_ValueError, "delay: expected less than a million cycles");
        return -1;
    }
    delay->depth = (size_t)longest + 3u;
    delay->rows = rows;
    delay->samples = lanes(self, which, delay->depth * rows);
    return delay->samples == NULL ? -1 : 0;
}

/* Numbers of the flights, in the rows of AMPI_FIXED and in the program's order. */
static int set_numbers(LoopObject *self, const double *fixed, const double *numbers) {
    ampi_loop *const loop = &self->loop;
    const ampi_program *const program = loop->plant.program;
    const size_t n = loop->flights;
    spread(fixed, AMPI_N_FIXED, n, loop->fixed);
    double *const places = lanes(self, PLACES, program->n_places);
    loop->n_limits = program->rates_and_use.n_outputs - PLANT_STATES;
    double *const peaks = lanes(self, PEAKS, loop->n_limits + 1u);
    if (places == NULL || peaks == NULL) {
        return -1;
    }
    loop->plant.places = places;
    loop->peak = (ampi_lanes *)(void *)peaks;
    for (size_t k = 0; k < program->n_numbers; k++) {
        spread(numbers + k * n, 1u, n, (ampi_lanes *)(void *)(places + program->numbers[k] * AMPI_LANES));
    }
    if (delayed(self, NAVIGATION, &loop->navigation, loop->fixed[AMPI_FIX_navigation_latency],
                PLANT_STATES) != 0) {
        return -1;
    }
    return delayed(self, ACTUATOR, &loop->actuator, loop->fixed[AMPI_FIX_actuator_delay],
                   PLANT_STEERING);
}

/* Profiles (n, points, functions): of the density if `has_density`, then of the wind. */
static int set_profiles(LoopObject *self, PyObject *values, double step, size_t points, int has_density,
                        int has_wind) {
    ampi_profiles *const own = &self->loop.profiles;
    const size_t n = self->loop.flights;
    const uint16_t inputs[3] = {PLANT_IN_DENSITY, PLANT_IN_EAST, PLANT_IN_NORTH};
    own->functions = (has_density ? 1u : 0u) + (has_wind ? 2u : 0u);
    own->points = points;
    own->step = step;
    memcpy(own->inputs, has_density ? inputs : inputs + 1, own->functions * sizeof(uint16_t));
    if (ampi_doubles(values, "profiles", n * points * own->functions, 0, &self->profiles) != 0) {
        return -1;
    }
    if (points < 2u) {
        PyErr_SetString(PyExc_ValueError, "profiles: expected at least two points");
        return -1;
    }
    for (size_t i = 0; i < AMPI_LANES; i++) {
        own->values[i] = (const double *)self->profiles.buf + (i < n ? i : 0u) * points * own->functions;
    }
    return 0;
}

/* The flights `first` to `first` + n of a guidance; of None: the steering is held. */
static int set_guidance(LoopObject *self, PyObject *object, Py_ssize_t first) {
    if (object == Py_None) {
        return 0;
    }
    if (!PyObject_TypeCheck(object, ampi_guidance_type)) {
        PyErr_SetString(PyExc_TypeError, "guidance: expected a Guidance or None");
        return -1;
    }
    GuidanceObject *const guidance = (GuidanceObject *)object;
    if (first < 0 || (size_t)first + self->loop.flights > guidance->n) {
        PyErr_SetString(PyExc_ValueError, "first: expected flights of the guidance");
        return -1;
    }
    self->guidance = Py_NewRef(object);
    self->loop.table = guidance->table;
    self->loop.guidance = guidance->guidance + first;
    self->loop.model = guidance->model;
    self->loop.corrector = guidance->corrector == NULL ? NULL : guidance->corrector + first;
    return 0;
}

static int set_settings(LoopObject *self, PyObject *settings) {
    Py_buffer view;
    if (ampi_doubles(settings, "settings", AMPI_N_SETTINGS, 0, &view) != 0) {
        return -1;
    }
    memcpy(self->loop.setting, view.buf, sizeof self->loop.setting);
    PyBuffer_Release(&view);
    const double *const own = self->loop.setting;
    if (!(own[AMPI_SET_parts] >= 1.0 && own[AMPI_SET_parts] < 1e6 && own[AMPI_SET_stride] >= 1.0 &&
          own[AMPI_SET_stride] < 1e15 && own[AMPI_SET_search] < 1e6)) {
        PyErr_SetString(PyExc_ValueError, "settings: expected parts and stride of at least 1");
        return -1;
    }
    return 0;
}

/* Loop(program, guidance, first, n, settings, fixed, numbers, profiles, step, points, has_density,
 *      has_wind, instruction_set) */
static int build(LoopObject *self, PyObject *arguments) {
    PyObject *program, *guidance, *settings, *fixed, *numbers, *profiles;
    Py_ssize_t first, n, points;
    double step;
    int has_density, has_wind;
    const char *name;
    Py_buffer rows, own;
    if (!PyArg_ParseTuple(arguments, "OOnnOOOOdniis", &program, &guidance, &first, &n, &settings, &fixed,
                          &numbers, &profiles, &step, &points, &has_density, &has_wind, &name)) {
        return -1;
    }
    if (!PyObject_TypeCheck(program, ampi_program_type) || n < 1 || n > AMPI_LANES || points < 0) {
        PyErr_Format(PyExc_ValueError, "Loop: expected a Program and 1 to %d flights", AMPI_LANES);
        return -1;
    }
    self->program = Py_NewRef(program);
    self->loop.plant.program = &((ProgramObject *)program)->program;
    self->loop.plant.profiles = &self->loop.profiles;
    self->loop.flights = (size_t)n;
    self->loop.plant.span = (ampi_span){0, (int)n, 1};
    self->loop.engine = ampi_engine_called(name);
    if (self->loop.engine == NULL || set_guidance(self, guidance, first) != 0 ||
        set_settings(self, settings) != 0 ||
        set_profiles(self, profiles, step, (size_t)points, has_density, has_wind) != 0 ||
        ampi_doubles(fixed, "fixed", AMPI_N_FIXED * (size_t)n, 0, &rows) != 0) {
        return -1;
    }
    int failed = ampi_doubles(numbers, "numbers", self->loop.plant.program->n_numbers * (size_t)n, 0, &own);
    if (failed == 0) {
        failed = set_numbers(self, rows.buf, own.buf);
        PyBuffer_Release(&own);
    }
    PyBuffer_Release(&rows);
    if (failed == 0) {
        ampi_loop_begin(&self->loop);
    }
    return failed;
}

static PyObject *loop_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
    (void)keywords;
    allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    LoopObject *self = (LoopObject *)allocate(type, 0);
    if (self != NULL && build(self, arguments) != 0) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static void loop_dealloc(PyObject *object) {
    LoopObject *const self = (LoopObject *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (size_t k = 0; k < sizeof self->memory / sizeof self->memory[0]; k++) {
        free(self->memory[k]);
    }
    if (self->profiles.obj != NULL) {
        PyBuffer_Release(&self->profiles);
    }
    Py_XDECREF(self->program);
    Py_XDECREF(self->guidance);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

/* fly(cycles, normal or None, uniform or None, record) */
static PyObject *fly(PyObject *object, PyObject *arguments) {
    LoopObject *const self = (LoopObject *)object;
    ampi_loop *const loop = &self->loop;
    PyObject *normal, *uniform, *record;
    Py_ssize_t cycles;
    Py_buffer gauss = {0}, even = {0}, notes = {0};
    if (!PyArg_ParseTuple(arguments, "nOOO", &cycles, &normal, &uniform, &record) || cycles < 0) {
        return NULL;
    }
    const size_t n = loop->flights, count = (size_t)cycles, stride = (size_t)loop->setting[AMPI_SET_stride];
    const size_t begun = loop->cycle + stride - 1u;
    const size_t records = (begun + count) / stride - begun / stride; /* multiples of the stride */
    const int is_noisy = normal != Py_None;
    size_t done = 0;
    int failed = is_noisy && ampi_doubles(normal, "normal", n * count * AMPI_NORMAL_ROWS, 0, &gauss) != 0;
    failed = failed || (is_noisy && ampi_doubles(uniform, "uniform", n * count, 0, &even) != 0);
    failed = failed || ampi_doubles(record, "record", records * AMPI_RECORD_ROWS * n, 1, &notes) != 0;
    if (!failed) {
        Py_BEGIN_ALLOW_THREADS
        done = ampi_loop_fly(loop, count, is_noisy ? gauss.buf : NULL, is_noisy ? even.buf : NULL,
                             notes.buf);
        Py_END_ALLOW_THREADS
    }
    if (gauss.obj != NULL) {
        PyBuffer_Release(&gauss);
    }
    if (even.obj != NULL) {
        PyBuffer_Release(&even);
    }
    if (notes.obj != NULL) {
        PyBuffer_Release(&notes);
    }
    return failed ? NULL : PyLong_FromSize_t(done);
}

/* results(out (rows, n)): rows of AMPI_RESULTS, then the peaks. */
static PyObject *results(PyObject *object, PyObject *array) {
    ampi_loop *const loop = &((LoopObject *)object)->loop;
    const size_t all = AMPI_END_peak + loop->n_limits;
    Py_buffer view;
    if (ampi_doubles(array, "out", all * loop->flights, 1, &view) != 0) {
        return NULL;
    }
    for (size_t row = 0; row < all; row++) {
        const double *const from =
            row < AMPI_END_peak ? loop->result[row] : loop->peak[row - AMPI_END_peak];
        memcpy((double *)view.buf + row * loop->flights, from, loop->flights * sizeof(double));
    }
    PyBuffer_Release(&view);
    return PyBool_FromLong(ampi_loop_flies(loop));
}

static PyMethodDef loop_methods[] = {
    {"fly", fly, METH_VARARGS, "fly(cycles, normal, uniform, record): how many cycles were flown."},
    {"results", results, METH_O, "results(out): what came of the flights; whether one flies still."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot loop_slots[] = {
    {Py_tp_new, (void *)loop_new},
    {Py_tp_dealloc, (void *)loop_dealloc},
    {Py_tp_methods, loop_methods},
    {Py_tp_doc, "Loop(program, guidance, first, n, ...): a closed loop of n flights at their entries."},
    {0, NULL},
};
PyType_Spec ampi_loop_spec = {"ampi._native._core.Loop", (int)sizeof(LoopObject), 0, Py_TPFLAGS_DEFAULT,
                              loop_slots};
