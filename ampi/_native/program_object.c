/* Program: lists of instructions, checked once, so that no list from Python reads beyond its memory. */
#include "objects.h"

#include <stdlib.h>
#include <string.h>

PyTypeObject *ampi_program_type;

#define LIST_NAME(name) #name,
static const char *const NAMES[] = {AMPI_OPERATIONS(LIST_NAME)};

/* The operands by the letters behind the last underscore. */
static int keeps_within(const ampi_instruction *at, size_t places, size_t scalars) {
    const char *kinds = strrchr(NAMES[at->opcode], '_');
    const uint16_t operands[3] = {at->a, at->b, at->c};
    const int is_pair = at->opcode == AMPI_OP_sincos_v;
    int good = at->result < places;
    good = good && (!is_pair || at->second < places);
    good = good && (!is_pair || at->b < places || at->b == AMPI_NOWHERE);
    if (at->opcode == AMPI_OP_fill) {
        return good && at->a < scalars;
    }
    if (at->opcode == AMPI_OP_horner) {
        return good && at->a < places && at->c >= 2u && (size_t)at->b + at->c <= scalars;
    }
    for (size_t k = 0; k < 3u && kinds[k + 1u] != '\0'; k++) {
        good = good && operands[k] < (kinds[k + 1u] == 's' ? scalars : places);
    }
    return good;
}

int ampi_check_list(const ampi_list *list, size_t places, size_t scalars) {
    for (size_t k = 0; k < list->count; k++) {
        if (list->code[k].opcode >= AMPI_N_OPERATIONS ||
            !keeps_within(&list->code[k], places, scalars)) {
            PyErr_Format(PyExc_ValueError, "code: expected known operations on %zu places and %zu "
                         "scalars, got another instruction %zu", places, scalars, k);
            return -1;
        }
    }
    for (size_t k = 0; k < list->n_outputs; k++) {
        if (list->outputs[k] >= places) {
            PyErr_Format(PyExc_ValueError, "outputs: expected places below %zu, got %u", places,
                         (unsigned)list->outputs[k]);
            return -1;
        }
    }
    return 0;
}

static ampi_list list_of(const Py_buffer *code, const Py_buffer *outputs) {
    const ampi_list list = {(const ampi_instruction *)code->buf,
                            (size_t)code->len / sizeof(ampi_instruction),
                            (const uint16_t *)outputs->buf, (size_t)outputs->len / sizeof(uint16_t)};
    return list;
}

/* The list in memory of its own, which begins at `*free` and is used up by it. */
static ampi_list kept(ampi_list list, unsigned char **free) {
    const size_t code = list.count * sizeof(ampi_instruction);
    const size_t outputs = list.n_outputs * sizeof(uint16_t);
    ampi_list own = list;
    memcpy(*free, list.code, code);
    own.code = (const ampi_instruction *)(void *)*free;
    *free += code;
    memcpy(*free, list.outputs, outputs);
    own.outputs = (const uint16_t *)(void *)*free;
    *free += outputs;
    return own;
}

enum { SCALARS, NUMBERS, LISTS, N_BUFFERS = LISTS + 8 };

static int build(ProgramObject *self, size_t places, const Py_buffer *buffers) {
    ampi_program *const own = &self->program;
    ampi_list *const lists[4] = {&own->begin, &own->rates, &own->rates_and_use, &own->sensed};
    size_t size = 0;
    for (size_t k = 0; k < N_BUFFERS; k++) {
        size += (size_t)buffers[k].len;
    }
    unsigned char *next = self->memory = malloc(size + 1u);
    if (next == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    own->n_places = places;
    own->n_scalars = (size_t)buffers[SCALARS].len / sizeof(double);
    memcpy(next, buffers[SCALARS].buf, (size_t)buffers[SCALARS].len);
    own->scalars = (const double *)(void *)next;
    next += buffers[SCALARS].len;
    own->n_numbers = (size_t)buffers[NUMBERS].len / sizeof(uint16_t);
    memcpy(next, buffers[NUMBERS].buf, (size_t)buffers[NUMBERS].len);
    own->numbers = (const uint16_t *)(void *)next;
    next += buffers[NUMBERS].len;
    for (size_t k = 0; k < 4u; k++) {
        *lists[k] = kept(list_of(&buffers[LISTS + 2u * k], &buffers[LISTS + 2u * k + 1u]), &next);
        if (ampi_check_list(lists[k], places, own->n_scalars) != 0) {
            return -1;
        }
    }
    const size_t known = own->rates.n_outputs == PLANT_STATES &&
                         own->rates_and_use.n_outputs >= PLANT_STATES && own->sensed.n_outputs == 3u &&
                         places >= PLANT_INPUTS;
    for (size_t k = 0; k < own->n_numbers; k++) {
        if (own->numbers[k] >= places) {
            PyErr_SetString(PyExc_ValueError, "numbers: expected places of the program");
            return -1;
        }
    }
    if (!known) {
        PyErr_SetString(PyExc_ValueError, "program: expected lists of rates, uses and accelerations");
        return -1;
    }
    return 0;
}

static PyObject *program_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
    Py_buffer b[N_BUFFERS];
    Py_ssize_t places;
    if (keywords != NULL && PyDict_Size(keywords) > 0) {
        PyErr_SetString(PyExc_TypeError, "Program: expected no keywords");
        return NULL;
    }
    if (!PyArg_ParseTuple(arguments, "ny*y*(y*y*)(y*y*)(y*y*)(y*y*)", &places, &b[0], &b[1], &b[2],
                          &b[3], &b[4], &b[5], &b[6], &b[7], &b[8], &b[9])) {
        return NULL;
    }
    allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    ProgramObject *self = (ProgramObject *)allocate(type, 0);
    if (self != NULL && build(self, (size_t)places, b) != 0) {
        Py_DECREF(self);
        self = NULL;
    }
    for (size_t k = 0; k < N_BUFFERS; k++) {
        PyBuffer_Release(&b[k]);
    }
    return (PyObject *)self;
}

static void program_dealloc(PyObject *object) {
    PyTypeObject *type = Py_TYPE(object);
    free(((ProgramObject *)object)->memory);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

static PyType_Slot program_slots[] = {
    {Py_tp_new, (void *)program_new},
    {Py_tp_dealloc, (void *)program_dealloc},
    {Py_tp_doc, "Program(places, scalars, numbers, begin, rates, rates_and_use, sensed)"},
    {0, NULL},
};
PyType_Spec ampi_program_spec = {"ampi._native._core.Program", (int)sizeof(ProgramObject), 0,
                                 Py_TPFLAGS_DEFAULT, program_slots};

static void evaluate(const ampi_engine *engine, const ampi_list *list, double *places,
                     const double *scalars, const double *in, size_t inputs, double *out, size_t n) {
    const ampi_span whole = {0, AMPI_LANES, 1};
    engine->forget(list, places);
    for (size_t first = 0; first < n; first += AMPI_LANES) {
        for (size_t i = 0; i < AMPI_LANES; i++) {
            const size_t own = first + i < n ? first + i : first;
            for (size_t k = 0; k < inputs; k++) {
                places[k * AMPI_LANES + i] = in[k * n + own];
            }
        }
        engine->run(list, places, scalars, whole);
        for (size_t i = 0; i < AMPI_LANES && first + i < n; i++) {
            for (size_t k = 0; k < list->n_outputs; k++) {
                out[k * n + first + i] = places[(size_t)list->outputs[k] * AMPI_LANES + i];
            }
        }
    }
}

/* evaluate(code, outputs, places, scalars, inputs (k, n), n, results (m, n), instruction_set) */
PyObject *ampi_evaluate(PyObject *module, PyObject *arguments) {
    Py_buffer code, outputs, scalars, in = {0}, out = {0};
    PyObject *inputs, *results;
    Py_ssize_t places, n;
    const char *name;
    PyObject *answer = NULL;
    (void)module;
    if (!PyArg_ParseTuple(arguments, "y*y*ny*OnOs", &code, &outputs, &places, &scalars, &inputs, &n,
                          &results, &name)) {
        return NULL;
    }
    const ampi_engine *const engine = ampi_engine_called(name);
    const ampi_list list = list_of(&code, &outputs);
    double *memory = NULL;
    if (engine != NULL && ampi_check_list(&list, (size_t)places, (size_t)scalars.len / 8u) == 0 &&
        PyObject_GetBuffer(inputs, &in, PyBUF_C_CONTIGUOUS) == 0) {
        const size_t rows = n > 0 ? (size_t)in.len / 8u / (size_t)n : 0u;
        if (rows > (size_t)places || rows * (size_t)n * 8u != (size_t)in.len) {
            PyErr_SetString(PyExc_ValueError, "inputs: expected rows of n float64, one a place");
        } else if ((memory = calloc((size_t)places * AMPI_LANES + 1u, sizeof(double))) == NULL) {
            PyErr_NoMemory();
        } else if (ampi_doubles(results, "results", list.n_outputs * (size_t)n, 1, &out) == 0) {
            evaluate(engine, &list, memory, scalars.buf, in.buf, rows, out.buf, (size_t)n);
            PyBuffer_Release(&out);
            answer = Py_None;
            Py_INCREF(answer);
        }
        PyBuffer_Release(&in);
    }
    free(memory);
    PyBuffer_Release(&code);
    PyBuffer_Release(&outputs);
    PyBuffer_Release(&scalars);
    return answer;
}
