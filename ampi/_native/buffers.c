/* Arrays from Python, and engines by their name. */
#include "objects.h"

#include <string.h>

int ampi_doubles(PyObject *array, const char *name, size_t count, int is_written, Py_buffer *view) {
    const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (is_written ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(array, view, flags) != 0) {
        PyErr_Format(PyExc_ValueError, "%s: expected a C-contiguous array of float64", name);
        return -1;
    }
    const int fits = view->format != NULL && strcmp(view->format, "d") == 0 &&
                     (size_t)view->len == count * sizeof(double);
    if (!fits) {
        PyErr_Format(PyExc_ValueError, "%s: expected %zu numbers of float64, got %zd bytes of %s", name,
                     count, view->len, view->format != NULL ? view->format : "B");
        PyBuffer_Release(view);
        return -1;
    }
    return 0;
}

const ampi_engine *ampi_engine_called(const char *name) {
    if (name[0] == '\0') {
        return ampi_engine_here();
    }
    if (strcmp(name, ampi_engine_baseline.name) == 0) {
        return &ampi_engine_baseline;
    }
    if (strcmp(name, ampi_engine_here()->name) == 0) {
        return ampi_engine_here();
    }
    PyErr_Format(PyExc_ValueError, "instruction set: expected %s or %s, got %s",
                 ampi_engine_baseline.name, ampi_engine_here()->name, name);
    return NULL;
}
