/* Guidance: the flight code of n flights, on one table. */
#include "objects.h"

#include <stdlib.h>
#include <string.h>

PyTypeObject *ampi_guidance_type;

PyTypeObject *ampi_table_type;

static PyObject *table_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
    PyObject *blob;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O", &blob)) {
        return NULL;
    }
    allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    TableObject *self = (TableObject *)allocate(type, 0);
    if (self == NULL || PyObject_GetBuffer(blob, &self->blob, PyBUF_SIMPLE) != 0) {
        Py_XDECREF((PyObject *)self);
        return NULL;
    }
    const ampi_status status =
        ampi_table_open(&self->table, self->blob.buf, (size_t)self->blob.len);
    if (status != AMPI_OK) {
        PyErr_Format(PyExc_ValueError, "blob: expected a guidance table, got status %d", (int)status);
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static void table_dealloc(PyObject *object) {
    TableObject *const self = (TableObject *)object;
    PyTypeObject *type = Py_TYPE(object);
    if (self->blob.obj != NULL) {
        PyBuffer_Release(&self->blob);
    }
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static PyType_Slot table_slots[] = {
    {Py_tp_new, (void *)table_new},
    {Py_tp_dealloc, (void *)table_dealloc},
    {Py_tp_doc, "Table(blob): a guidance table, checked and opened."},
    {0, NULL},
};
PyType_Spec ampi_table_spec = {"ampi._native._core.Table", (int)sizeof(TableObject), 0,
                               Py_TPFLAGS_DEFAULT, table_slots};

PyTypeObject *ampi_model_type;

static PyObject *model_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
    PyObject *blob;
    Py_buffer bytes;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O", &blob) || PyObject_GetBuffer(blob, &bytes, PyBUF_SIMPLE) != 0) {
        return NULL;
    }
    allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    ModelObject *self = (ModelObject *)allocate(type, 0);
    if (self != NULL) {
        const ampi_status status = ampi_model_open(&self->model, bytes.buf, (size_t)bytes.len);
        if (status != AMPI_OK) {
            PyErr_Format(PyExc_ValueError, "blob: expected a model, got status %d", (int)status);
            Py_DECREF(self);
            self = NULL;
        }
    }
    PyBuffer_Release(&bytes);
    return (PyObject *)self;
}

static void model_dealloc(PyObject *object) {
    PyTypeObject *type = Py_TYPE(object);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static PyType_Slot model_slots[] = {
    {Py_tp_new, (void *)model_new},
    {Py_tp_dealloc, (void *)model_dealloc},
    {Py_tp_doc, "Model(blob): a model of vehicle and air, checked and opened."},
    {0, NULL},
};
PyType_Spec ampi_model_spec = {"ampi._native._core.Model", (int)sizeof(ModelObject), 0,
                               Py_TPFLAGS_DEFAULT, model_slots};

static PyObject *guidance_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
    PyObject *table, *model;
    Py_ssize_t n;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "OnO", &table, &n, &model)) {
        return NULL;
    }
    if (!PyObject_TypeCheck(table, ampi_table_type) || n < 1 ||
        !(model == Py_None || PyObject_TypeCheck(model, ampi_model_type))) {
        PyErr_SetString(PyExc_ValueError,
                        "Guidance: expected a Table, at least one flight, and a Model or None");
        return NULL;
    }
    allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    GuidanceObject *self = (GuidanceObject *)allocate(type, 0);
    if (self == NULL) {
        return NULL;
    }
    self->owner = Py_NewRef(table);
    self->table = &((TableObject *)table)->table;
    self->n = (size_t)n;
    self->guidance = calloc(self->n, sizeof(ampi_guidance));
    if (model != Py_None) {
        self->model_owner = Py_NewRef(model);
        self->model = &((ModelObject *)model)->model;
        self->corrector = calloc(self->n, sizeof(ampi_corrector));
    }
    if (self->guidance == NULL || (self->model != NULL && self->corrector == NULL)) {
        PyErr_NoMemory();
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static void guidance_dealloc(PyObject *object) {
    GuidanceObject *const self = (GuidanceObject *)object;
    PyTypeObject *type = Py_TYPE(object);
    free(self->guidance);
    free(self->corrector);
    Py_XDECREF(self->model_owner);
    Py_XDECREF(self->owner);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static PyObject *begin(PyObject *object, PyObject *parameters) {
    GuidanceObject *const self = (GuidanceObject *)object;
    Py_buffer told;
    if (ampi_doubles(parameters, "parameters", self->n * self->table->n.axes, 0, &told) != 0) {
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    for (size_t i = 0; i < self->n; i++) {
        const double *const own = (const double *)told.buf + i * self->table->n.axes;
        ampi_guidance_begin(&self->guidance[i], self->table, own);
        if (self->corrector != NULL) {
            ampi_corrector_begin(&self->corrector[i], self->model, self->table, own);
        }
    }
    Py_END_ALLOW_THREADS
    PyBuffer_Release(&told);
    Py_RETURN_NONE;
}

/* follow(parameters (n, d), nodal (n, nodes, r), told (n, 2)): references of Python's own making, each with
 * its final time and health. */
static PyObject *follow(PyObject *object, PyObject *const *arguments, Py_ssize_t count) {
    GuidanceObject *const self = (GuidanceObject *)object;
    const ampi_table *const table = self->table;
    const size_t axes = table->n.axes, rows = table->n.rows, nodes = table->n.nodes;
    const size_t sizes[3] = {self->n * axes, self->n * nodes * rows, self->n * 2u};
    const char *const names[3] = {"parameters", "nodal", "told"};
    Py_buffer views[3];
    int given = 0;
    if (count != 3) {
        PyErr_SetString(PyExc_TypeError, "follow: expected parameters, nodal, told");
        return NULL;
    }
    while (given < 3 && ampi_doubles(arguments[given], names[given], sizes[given], 0, &views[given]) == 0) {
        given++;
    }
    ampi_reference *const own = given == 3 ? calloc(1, sizeof(ampi_reference)) : NULL;
    for (size_t i = 0; own != NULL && i < self->n; i++) {
        const double *const parameters = (const double *)views[0].buf + i * axes;
        const double *const nodal = (const double *)views[1].buf + i * nodes * rows;
        const double *const told = (const double *)views[2].buf + i * 2u;
        memcpy(own->rows, nodal, nodes * rows * sizeof(double));
        own->final_time = told[0];
        own->health = (int32_t)told[1];
        own->checksum = table->checksum;
        if (self->guidance[i].is_begun == 0u) {
            ampi_guidance_begin(&self->guidance[i], table, parameters);
        }
        const uint32_t begins = self->guidance[i].begins; /* Python says when a flight may begin */
        ampi_guidance_follow(&self->guidance[i], table, own, parameters);
        self->guidance[i].begins = begins;
    }
    const int failed = given == 3 && own == NULL;
    free(own);
    while (given > 0) {
        PyBuffer_Release(&views[--given]);
    }
    if (failed) {
        PyErr_NoMemory();
    }
    return PyErr_Occurred() != NULL ? NULL : Py_NewRef(Py_None);
}

static PyObject *reset(PyObject *object, PyObject *nothing) {
    GuidanceObject *const self = (GuidanceObject *)object;
    (void)nothing;
    for (size_t i = 0; i < self->n; i++) {
        ampi_guidance_reset(&self->guidance[i], self->table);
        if (self->corrector != NULL) {
            double target[4];
            memcpy(target, self->corrector[i].target, sizeof target);
            ampi_corrector_begin(&self->corrector[i], self->model, self->table, NULL);
            ampi_corrector_aim(&self->corrector[i], target);
        }
    }
    Py_RETURN_NONE;
}

static PyObject *expect_begin(PyObject *object, PyObject *nothing) {
    GuidanceObject *const self = (GuidanceObject *)object;
    (void)nothing;
    for (size_t i = 0; i < self->n; i++) {
        self->guidance[i].begins = 1u;
    }
    Py_RETURN_NONE;
}

enum { COMMAND_ROWS = 5 };

/* Steps all flights: commands (5, n) are bank rate, bank angle, angle of attack, steering, health. */
static void step_all(GuidanceObject *self, double time, const double *navigation, const double *sensed,
                     double *commands, double *rows) {
    const size_t n = self->n;
    for (size_t i = 0; i < n; i++) {
        double told[AMPI_N_NAVIGATED], felt[3];
        for (size_t row = 0; row < AMPI_N_NAVIGATED; row++) {
            told[row] = navigation[row * n + i];
        }
        for (size_t row = 0; sensed != NULL && row < 3u; row++) {
            felt[row] = sensed[row * n + i];
        }
        const double *const known = sensed != NULL ? felt : NULL;
        const ampi_command command =
            self->corrector == NULL
                ? ampi_guidance_step(&self->guidance[i], self->table, time, told, known)
                : ampi_corrected_step(&self->corrector[i], self->model, &self->guidance[i], self->table,
                                      time, told, known);
        commands[i] = command.bank_rate;
        commands[n + i] = command.bank_angle;
        commands[2u * n + i] = command.angle_of_attack;
        commands[3u * n + i] = (double)command.steering;
        commands[4u * n + i] = (double)command.health;
        for (size_t row = 0; row < self->table->n.rows; row++) {
            rows[row * n + i] = self->guidance[i].row[row];
        }
    }
}

/* step(time, navigation (8, n), sensed (3, n) or None, commands (5, n), rows (r, n)) */
static PyObject *step(PyObject *object, PyObject *const *arguments, Py_ssize_t count) {
    GuidanceObject *const self = (GuidanceObject *)object;
    Py_buffer navigation, sensed, commands, rows;
    if (count != 5) {
        PyErr_SetString(PyExc_TypeError, "step: expected time, navigation, sensed, commands, rows");
        return NULL;
    }
    const double time = PyFloat_AsDouble(arguments[0]);
    if ((time == -1.0 && PyErr_Occurred() != NULL) ||
        ampi_doubles(arguments[1], "navigation", AMPI_N_NAVIGATED * self->n, 0, &navigation) != 0) {
        return NULL;
    }
    PyObject *answer = NULL;
    const int feels = arguments[2] != Py_None;
    if (!feels || ampi_doubles(arguments[2], "sensed", 3u * self->n, 0, &sensed) == 0) {
        if (ampi_doubles(arguments[3], "commands", COMMAND_ROWS * self->n, 1, &commands) == 0) {
            if (ampi_doubles(arguments[4], "rows", self->table->n.rows * self->n, 1, &rows) == 0) {
                step_all(self, time, navigation.buf, feels ? sensed.buf : NULL, commands.buf,
                         rows.buf);
                PyBuffer_Release(&rows);
                answer = Py_NewRef(Py_None);
            }
            PyBuffer_Release(&commands);
        }
        if (feels) {
            PyBuffer_Release(&sensed);
        }
    }
    PyBuffer_Release(&navigation);
    return answer;
}

/* flown(told (4, n), nodal (n, nodes, r)): of the references flown final time, whether clipped, whether
 * there is a hole, health; and their rows at the nodes */
static PyObject *flown(PyObject *object, PyObject *const *arguments, Py_ssize_t count) {
    GuidanceObject *const self = (GuidanceObject *)object;
    const ampi_table *const table = self->table;
    const size_t n = self->n, nodes = table->n.nodes, rows = table->n.rows;
    Py_buffer told, nodal;
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "flown: expected told, nodal");
        return NULL;
    }
    if (ampi_doubles(arguments[0], "told", 4u * n, 1, &told) != 0) {
        return NULL;
    }
    if (ampi_doubles(arguments[1], "nodal", n * nodes * rows, 1, &nodal) != 0) {
        PyBuffer_Release(&told);
        return NULL;
    }
    for (size_t i = 0; i < n; i++) {
        const ampi_reference *const own = &self->guidance[i].reference;
        double *const out = (double *)told.buf + i, *const values = (double *)nodal.buf + i * nodes * rows;
        uint32_t clipped = 0;
        for (size_t axis = 0; axis < table->n.axes; axis++) {
            clipped |= own->clipped[axis];
        }
        out[0] = own->final_time;
        out[n] = clipped != 0u ? 1.0 : 0.0;
        out[2u * n] = own->hole != 0u ? 1.0 : 0.0;
        out[3u * n] = (double)own->health;
        memcpy(values, own->rows, nodes * rows * sizeof(double));
    }
    PyBuffer_Release(&nodal);
    PyBuffer_Release(&told);
    Py_RETURN_NONE;
}

/* reference(parameters (d), low (n r + 1), times (m), rows (r, m)): one, with its nodes and t_f */
static PyObject *reference(PyObject *object, PyObject *arguments) {
    GuidanceObject *const self = (GuidanceObject *)object;
    const ampi_table *const table = self->table;
    PyObject *p, *low, *times, *rows, *answer = NULL;
    Py_buffer told, nodal, when, high;
    if (!PyArg_ParseTuple(arguments, "OOOO", &p, &low, &times, &rows) ||
        ampi_doubles(p, "parameters", table->n.axes, 0, &told) != 0) {
        return NULL;
    }
    if (ampi_doubles(low, "low", table->n.rows * table->n.nodes + 1u, 1, &nodal) == 0) {
        if (ampi_doubles(times, "times", table->n.points, 1, &when) == 0) {
            if (ampi_doubles(rows, "rows", table->n.rows * table->n.points, 1, &high) == 0) {
                ampi_reference own;
                ampi_reference_at(table, told.buf, &own);
                memcpy(nodal.buf, own.rows, (size_t)nodal.len);
                ampi_reference_high_density(table, &own, when.buf, high.buf);
                PyBuffer_Release(&high);
                answer = Py_NewRef(Py_None);
            }
            PyBuffer_Release(&when);
        }
        PyBuffer_Release(&nodal);
    }
    PyBuffer_Release(&told);
    return answer;
}

/* corrected(out (rows, n)): what estimators and correctors know, in the rows of AMPI_CORRECTED. */
static PyObject *corrected(PyObject *object, PyObject *array) {
    GuidanceObject *const self = (GuidanceObject *)object;
    const size_t n = self->n;
    Py_buffer view;
    if (self->corrector == NULL) {
        PyErr_SetString(PyExc_ValueError, "corrected: expected a guidance with a model");
        return NULL;
    }
    if (ampi_doubles(array, "out", AMPI_N_CORRECTED * n, 1, &view) != 0) {
        return NULL;
    }
    for (size_t i = 0; i < n; i++) {
        const ampi_corrector *const own = &self->corrector[i];
        const ampi_estimate *const estimate = &own->estimate;
        double *const out = (double *)view.buf + i;
        for (size_t k = 0; k < AMPI_N_CORRECTIONS; k++) {
            out[(AMPI_COR_count + k) * n] = (double)own->count[k];
        }
        for (size_t k = 0; k < AMPI_N_MISSED; k++) { out[(AMPI_COR_missed + k) * n] = own->missed[k]; }
        for (size_t k = 0; k < AMPI_N_PLAN; k++) { out[(AMPI_COR_plan + k) * n] = own->plan.value[k]; }
        for (size_t k = 0; k < AMPI_N_ESTIMATED; k++) {
            out[(AMPI_COR_mean + k) * n] = estimate->mean[k];
            for (size_t j = 0; j < AMPI_N_ESTIMATED; j++) {
                out[(AMPI_COR_covariance + k * AMPI_N_ESTIMATED + j) * n] = estimate->covariance[k][j];
            }
        }
        const double learnt[] = {estimate->used, estimate->weak, estimate->unusable,
                                 estimate->stuck, estimate->gated, estimate->reset};
        for (size_t k = 0; k < sizeof learnt / sizeof *learnt; k++) {
            out[(AMPI_COR_learnt + k) * n] = learnt[k];
        }
        out[AMPI_COR_outcome * n] = own->outcome;
        out[AMPI_COR_to_go * n] = own->to_go;
        out[AMPI_COR_iterations * n] = own->iterations;
        out[AMPI_COR_propagations * n] = own->propagations;
        out[AMPI_COR_fast * n] = own->plan.fast;
        out[AMPI_COR_slow * n] = own->plan.slow;
        out[AMPI_COR_altitude * n] = estimate->altitude;
        out[AMPI_COR_nis * n] = estimate->nis;
        out[AMPI_COR_change * n] = own->change;
        out[AMPI_COR_next * n] = own->next;
    }
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

/* aim(targets (4, n)) */
static PyObject *aim(PyObject *object, PyObject *array) {
    GuidanceObject *const self = (GuidanceObject *)object;
    Py_buffer view;
    if (self->corrector == NULL) {
        PyErr_SetString(PyExc_ValueError, "aim: expected a guidance with a model");
        return NULL;
    }
    if (ampi_doubles(array, "targets", 4u * self->n, 0, &view) != 0) {
        return NULL;
    }
    for (size_t i = 0; i < self->n; i++) {
        double target[4];
        for (size_t k = 0; k < 4u; k++) { target[k] = ((const double *)view.buf)[k * self->n + i]; }
        ampi_corrector_aim(&self->corrector[i], target);
    }
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

static PyMethodDef guidance_methods[] = {
    {"corrected", corrected, METH_O, "corrected(out): what estimators and correctors know."},
    {"aim", aim, METH_O, "aim(targets): the targets (4, n) from the next correction on."},
    {"begin", begin, METH_O, "begin(parameters): begin n flights of p (n, d)."},
    {"follow", (PyCFunction)(void (*)(void))follow, METH_FASTCALL,
     "follow(parameters, nodal, told): fly these references; the clock goes on."},
    {"reset", reset, METH_NOARGS, "reset(): begin other flights on the same references."},
    {"expect_begin", expect_begin, METH_NOARGS,
     "expect_begin(): the next time begins a flight if it does not go on."},
    {"step", (PyCFunction)(void (*)(void))step, METH_FASTCALL,
     "step(time, navigation, sensed, commands, rows): one cycle of all flights."},
    {"flown", (PyCFunction)(void (*)(void))flown, METH_FASTCALL,
     "flown(told, nodal): final time, clipped, hole and health (4, n), and the references' rows."},
    {"reference", reference, METH_VARARGS, "reference(parameters, low, times, rows): one reference."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot guidance_slots[] = {
    {Py_tp_new, (void *)guidance_new},
    {Py_tp_dealloc, (void *)guidance_dealloc},
    {Py_tp_methods, guidance_methods},
    {Py_tp_doc, "Guidance(table, n, model): the flight code of n flights."},
    {0, NULL},
};
PyType_Spec ampi_guidance_spec = {"ampi._native._core.Guidance", (int)sizeof(GuidanceObject), 0,
                                  Py_TPFLAGS_DEFAULT, guidance_slots};
