/* The extension module ampi._native._core. */
#include "objects.h"

typedef struct {
    const char *name;
    long first, count;
} rows;

#define SETTING(name, count) {#name, AMPI_SET_##name, count},
#define FIXED(name, count) {#name, AMPI_FIX_##name, count},
#define RESULT(name, count) {#name, AMPI_END_##name, count},
#define CORRECTED(name, count) {#name, AMPI_COR_##name, (long)(count)},
#define END {NULL, 0, 0}
static const rows SETTINGS[] = {AMPI_SETTINGS(SETTING) END};
static const rows FIXED_ROWS[] = {AMPI_FIXED(FIXED) END};
static const rows RESULT_ROWS[] = {AMPI_RESULTS(RESULT) END};
static const rows CORRECTED_ROWS[] = {AMPI_CORRECTED(CORRECTED) END};

/* {name: (first row, rows)} */
static int add_rows(PyObject *module, const char *name, const rows *first) {
    PyObject *const found = PyDict_New();
    int failed = found == NULL;
    for (const rows *at = first; !failed && at->name != NULL; at++) {
        PyObject *const pair = Py_BuildValue("(ll)", at->first, at->count);
        failed = pair == NULL || PyDict_SetItemString(found, at->name, pair) != 0;
        Py_XDECREF(pair);
    }
    failed = failed || PyModule_AddObjectRef(module, name, found) != 0;
    Py_XDECREF(found);
    return failed ? -1 : 0;
}

#define NAMED(name) #name,
static int add_opcodes(PyObject *module) {
    static const char *const names[] = {AMPI_OPERATIONS(NAMED)};
    PyObject *const found = PyDict_New();
    int failed = found == NULL;
    for (long k = 0; !failed && k < AMPI_N_OPERATIONS; k++) {
        PyObject *const number = PyLong_FromLong(k);
        failed = number == NULL || PyDict_SetItemString(found, names[k], number) != 0;
        Py_XDECREF(number);
    }
    failed = failed || PyModule_AddObjectRef(module, "OPCODES", found) != 0;
    Py_XDECREF(found);
    return failed ? -1 : 0;
}

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec, const char *name) {
    PyObject *const type = PyType_FromModuleAndSpec(module, spec, NULL);
    if (type == NULL || PyModule_AddObjectRef(module, name, type) != 0) {
        Py_XDECREF(type);
        return NULL;
    }
    return (PyTypeObject *)type;
}

static PyMethodDef functions[] = {
    {"evaluate", ampi_evaluate, METH_VARARGS,
     "evaluate(code, outputs, places, scalars, inputs, n, results, instruction_set)"},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_core", "The plant, the closed loop and the flight code, compiled.", -1,
    functions, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__core(void) {
    PyObject *const module = PyModule_Create(&definition);
    if (module == NULL) {
        return NULL;
    }
    ampi_program_type = add_type(module, &ampi_program_spec, "Program");
    ampi_table_type = add_type(module, &ampi_table_spec, "Table");
    ampi_model_type = add_type(module, &ampi_model_spec, "Model");
    ampi_guidance_type = add_type(module, &ampi_guidance_spec, "Guidance");
    PyTypeObject *const loop = add_type(module, &ampi_loop_spec, "Loop");
    if (ampi_program_type == NULL || ampi_table_type == NULL || ampi_model_type == NULL ||
        ampi_guidance_type == NULL ||
        loop == NULL ||
        add_rows(module, "SETTINGS", SETTINGS) != 0 || add_rows(module, "FIXED", FIXED_ROWS) != 0 ||
        add_rows(module, "RESULTS", RESULT_ROWS) != 0 ||
        add_rows(module, "CORRECTED", CORRECTED_ROWS) != 0 || add_opcodes(module) != 0 ||
        PyModule_AddObject(module, "MOST", Py_BuildValue("(kkkkkk)", (unsigned long)AMPI_MAX_AXES,
            (unsigned long)AMPI_MAX_ROWS, (unsigned long)AMPI_MAX_NODES, (unsigned long)AMPI_MAX_SEGMENTS,
            (unsigned long)AMPI_MAX_DEGREE_NODES, (unsigned long)AMPI_MAX_POINTS)) != 0 ||
        PyModule_AddIntConstant(module, "LANES", AMPI_LANES) != 0 ||
        PyModule_AddIntConstant(module, "RECORD_ROWS", AMPI_RECORD_ROWS) != 0 ||
        PyModule_AddStringConstant(module, "INSTRUCTION_SET", ampi_engine_here()->name) != 0 ||
        PyModule_AddStringConstant(module, "BASELINE", ampi_engine_baseline.name) != 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
