/* What the extension's files share: CPython's limited interface, buffers, and the three types.
 *
 * Arrays come as buffers, so that nothing depends on the numpy that is installed. */
#ifndef AMPI_OBJECTS_H
#define AMPI_OBJECTS_H

#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "loop.h"

/* What is told of the correctors of n flights. */
#define AMPI_CORRECTED(X) \
    X(outcome, 1) X(count, AMPI_N_CORRECTIONS) X(missed, AMPI_N_MISSED) X(to_go, 1) X(iterations, 1) \
    X(propagations, 1) X(fast, 1) X(slow, 1) X(plan, AMPI_N_PLAN) X(mean, AMPI_N_ESTIMATED) \
    X(covariance, AMPI_N_ESTIMATED * AMPI_N_ESTIMATED) X(altitude, 1) X(nis, 1) X(learnt, 6) X(change, 1) \
    X(next, 1)
#define AMPI_COR_ROW(name, count) AMPI_ROWS_UP_TO(AMPI_COR_, name, (long)(count))
enum { AMPI_CORRECTED(AMPI_COR_ROW) AMPI_N_CORRECTED };

/* A C-contiguous buffer of `count` float64; otherwise a ValueError that names it, and -1. */
int ampi_doubles(PyObject *array, const char *name, size_t count, int is_written, Py_buffer *view);

/* An engine by name, "" being the best one here; NULL with a ValueError. */
const ampi_engine *ampi_engine_called(const char *name);

/* Whether a list keeps within its places and scalars; -1 with a ValueError. */
int ampi_check_list(const ampi_list *list, size_t places, size_t scalars);

typedef struct {
    PyObject_HEAD
    ampi_program program;
    void *memory;
} ProgramObject;

typedef struct {
    PyObject_HEAD
    Py_buffer blob;
    ampi_table table;
} TableObject;

typedef struct {
    PyObject_HEAD
    ampi_model model;
} ModelObject;

typedef struct {
    PyObject_HEAD
    PyObject *owner, *model_owner; /* of the table, of the model or NULL */
    const ampi_table *table;
    const ampi_model *model;   /* NULL: plans are not corrected */
    ampi_guidance *guidance;   /* (n) */
    ampi_corrector *corrector; /* (n), or NULL */
    size_t n;
} GuidanceObject;

extern PyType_Spec ampi_program_spec, ampi_table_spec, ampi_model_spec, ampi_guidance_spec, ampi_loop_spec;
extern PyTypeObject *ampi_program_type, *ampi_table_type, *ampi_model_type, *ampi_guidance_type;

PyObject *ampi_evaluate(PyObject *module, PyObject *arguments);

#endif
