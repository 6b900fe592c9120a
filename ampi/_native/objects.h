/* What the extension's files share: CPython's limited interface, buffers, and the three types.
 *
 * Arrays come as buffers, so that nothing depends on the numpy that is installed. */
#ifndef AMPI_OBJECTS_H
#define AMPI_OBJECTS_H

#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "loop.h"

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
    PyObject *owner; /* of the table */
    const ampi_table *table;
    ampi_guidance *guidance; /* (n) */
    size_t n;
} GuidanceObject;

extern PyType_Spec ampi_program_spec, ampi_table_spec, ampi_guidance_spec, ampi_loop_spec;
extern PyTypeObject *ampi_program_type, *ampi_table_type, *ampi_guidance_type;

PyObject *ampi_evaluate(PyObject *module, PyObject *arguments);

#endif
