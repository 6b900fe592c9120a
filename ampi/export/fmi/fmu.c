#include "fmu.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SENTENCE 512u
#define TABLE "ampi_table.bin"
/* Rows of a reference, after the six other states. */
#define BANK_ANGLE 6u
#define BANK_RATE 7u

static const double START[FMU_N_VALUES] = FMU_START;

fmu *fmu_new(void (*tell)(const fmu *unit, const char *sentence), fmu_function *logger,
             void *environment, const char *name)
{
    fmu *unit = calloc(1u, sizeof *unit);
    if (unit != NULL) {
        const char *own = (name != NULL) ? name : "";
        unit->tell = tell;
        unit->logger = logger;
        unit->environment = environment;
        unit->name = calloc(strlen(own) + 1u, 1u);
        if (unit->name == NULL) {
            free(unit);
            return NULL;
        }
        memcpy(unit->name, own, strlen(own));
    }
    return unit;
}

void fmu_free(fmu *unit)
{
    if (unit != NULL) {
        free(unit->blob);
        free(unit->name);
        free(unit);
    }
}

fmu_status fmu_fail(const fmu *unit, const char *call, const char *why)
{
    char sentence[SENTENCE];
    if (unit != NULL) {
        (void)snprintf(sentence, sizeof sentence, "%s: %s", call, why);
        unit->tell(unit, sentence);
    }
    return FMU_ERROR;
}

static const char *sentence_of(ampi_status status)
{
    switch (status) {
    case AMPI_TRUNCATED:
        return "the table is shorter or longer than it says";
    case AMPI_FOREIGN:
        return "the file is not a guidance table";
    case AMPI_BYTE_ORDER:
        return "the table is of a machine of the other byte order";
    case AMPI_VERSION:
        return "the table has a format that this code does not know";
    case AMPI_CHECKSUM:
        return "the table is damaged: its checksum is another one";
    case AMPI_TOO_LARGE:
        return "the table is larger than what this code was compiled for";
    case AMPI_INCONSISTENT:
        return "the table has a size or a number that cannot be";
    default:
        return "the table cannot be read";
    }
}

/* The bytes of a file, NULL if it cannot be read. */
static unsigned char *bytes_of(const char *path, size_t *size)
{
    unsigned char *bytes = NULL;
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return NULL;
    }
    if (fseek(file, 0L, SEEK_END) == 0) {
        const long length = ftell(file);
        if ((length > 0L) && (fseek(file, 0L, SEEK_SET) == 0)) {
            *size = (size_t)length;
            bytes = malloc(*size);
            if ((bytes != NULL) && (fread(bytes, 1u, *size, file) != *size)) {
                free(bytes);
                bytes = NULL;
            }
        }
    }
    (void)fclose(file);
    return bytes;
}

/* Whether the table of the folder is open; if not, why has been told. */
static int open_table(fmu *unit, const char *folder)
{
    const size_t length = strlen(folder);
    const char *between = ((length > 0u) && (folder[length - 1u] == '/')) ? "" : "/";
    char *path = malloc(length + sizeof TABLE + 1u);
    size_t size = 0u;
    ampi_status status;

    if (path == NULL) {
        (void)fmu_fail(unit, "Instantiate", "there is no memory");
        return 0;
    }
    (void)sprintf(path, "%s%s%s", folder, between, TABLE);
    unit->blob = bytes_of(path, &size);
    free(path);
    if (unit->blob == NULL) {
        (void)fmu_fail(unit, "Instantiate",
                       "expected the file " TABLE " in the folder of resources, it cannot be read");
        return 0;
    }
    status = ampi_table_open(&unit->table, unit->blob, size);
    if ((status == AMPI_OK) && (unit->table.n.axes != (uint32_t)FMU_N_PARAMETERS)) {
        status = AMPI_INCONSISTENT;
    }
    if (status != AMPI_OK) {
        (void)fmu_fail(unit, "Instantiate", sentence_of(status));
    }
    return (status == AMPI_OK) ? 1 : 0;
}

static void start(fmu *unit)
{
    unit->flight.phase = FMU_INSTANTIATED;
    unit->flight.is_begun = 0u;
    memcpy(unit->flight.value, START, sizeof START);
}

fmu *fmu_opened(fmu *unit, const char *token, const char *folder)
{
    if (unit == NULL) {
        return NULL;
    }
    if ((token == NULL) || (strcmp(token, FMU_TOKEN) != 0)) {
        (void)fmu_fail(unit, "Instantiate",
                       "expected the token " FMU_TOKEN ", this model description is of another FMU");
    } else if (folder == NULL) {
        (void)fmu_fail(unit, "Instantiate", "expected a folder of resources, got none");
    } else if (open_table(unit, folder) != 0) {
        start(unit);
        return unit;
    }
    fmu_free(unit);
    return NULL;
}

/* Begins the flight of the parameters that are set. Before the first cycle the command is the
   reference's own, at its begin. */
static void begin(fmu *unit)
{
    fmu_flight *flight = &unit->flight;
    const ampi_reference *reference = &flight->guidance.reference;

    if (flight->is_begun == 0u) {
        ampi_guidance_begin(&flight->guidance, &unit->table, &flight->value[FMU_PARAMETERS]);
        flight->value[FMU_BANK_RATE] = (double)reference->rows[BANK_RATE];
        flight->value[FMU_BANK_ANGLE] = (double)reference->rows[BANK_ANGLE];
        flight->value[FMU_ANGLE_OF_ATTACK] =
            (unit->table.angle_row != 0u) ? (double)reference->rows[unit->table.angle_row] : 0.0;
        flight->value[FMU_STEERING] = (double)AMPI_REFERENCE;
        flight->value[FMU_HEALTH] = (double)reference->health;
        flight->is_begun = 1u;
    }
}

static int is_enumeration(uint32_t reference)
{
    return ((reference == (uint32_t)FMU_STEERING) || (reference == (uint32_t)FMU_HEALTH)) ? 1 : 0;
}

fmu_status fmu_get(fmu *unit, const uint32_t *references, size_t n, double *values)
{
    size_t i;
    if (unit == NULL) {
        return FMU_ERROR;
    }
    begin(unit);
    for (i = 0u; i < n; i++) {
        if ((references[i] >= (uint32_t)FMU_N_VALUES) || (is_enumeration(references[i]) != 0)) {
            return fmu_fail(unit, "Get", "expected references of real variables, got another");
        }
    }
    for (i = 0u; i < n; i++) {
        values[i] = unit->flight.value[references[i]];
    }
    return FMU_OK;
}

fmu_status fmu_get_enumeration(fmu *unit, uint32_t reference, int32_t *value)
{
    if (unit == NULL) {
        return FMU_ERROR;
    }
    if (is_enumeration(reference) == 0) {
        return fmu_fail(unit, "Get", "expected references of steering or health, got another");
    }
    begin(unit);
    *value = (int32_t)unit->flight.value[reference];
    return FMU_OK;
}

/* Why a value may not be set now; NULL: it may. */
static const char *why_not(const fmu *unit, uint32_t reference)
{
    const fmu_phase phase = unit->flight.phase;
    if (phase == FMU_TERMINATED) {
        return "expected an FMU that has not been terminated";
    }
    if ((reference >= (uint32_t)FMU_PARAMETERS) && (reference < (uint32_t)FMU_N_VALUES)) {
        return (phase == FMU_STEPPING) ? "expected parameters before the flight begins" : NULL;
    }
    if ((reference < (uint32_t)FMU_NAVIGATION) || (reference >= (uint32_t)FMU_BANK_RATE)) {
        return "expected references of inputs or parameters, got another";
    }
    return NULL;
}

fmu_status fmu_set(fmu *unit, const uint32_t *references, size_t n, const double *values)
{
    size_t i;
    if (unit == NULL) {
        return FMU_ERROR;
    }
    for (i = 0u; i < n; i++) {
        const char *why = why_not(unit, references[i]);
        if (why != NULL) {
            return fmu_fail(unit, "Set", why);
        }
    }
    for (i = 0u; i < n; i++) {
        unit->flight.value[references[i]] = values[i];
        if (references[i] >= (uint32_t)FMU_PARAMETERS) {
            unit->flight.is_begun = 0u;
        }
    }
    return FMU_OK;
}

static const char *const STANDS[] = {"it is instantiated", "it is in initialization mode",
                                     "its flight has begun", "it is terminated"};

/* That the unit is not where `call` expects it. */
static fmu_status out_of_order(const fmu *unit, const char *call)
{
    char why[SENTENCE];
    if (unit == NULL) {
        return FMU_ERROR;
    }
    (void)snprintf(why, sizeof why, "is not to be called now: %s", STANDS[unit->flight.phase]);
    return fmu_fail(unit, call, why);
}

fmu_status fmu_set_start_time(fmu *unit, double time)
{
    if ((unit == NULL) || (unit->flight.phase != FMU_INSTANTIATED)) {
        return out_of_order(unit, "start time");
    }
    unit->flight.value[FMU_TIME] = time;
    return FMU_OK;
}

fmu_status fmu_enter_initialization(fmu *unit)
{
    if ((unit == NULL) || (unit->flight.phase != FMU_INSTANTIATED)) {
        return out_of_order(unit, "EnterInitializationMode");
    }
    unit->flight.phase = FMU_INITIALIZATION;
    return FMU_OK;
}

fmu_status fmu_exit_initialization(fmu *unit)
{
    if ((unit == NULL) || (unit->flight.phase != FMU_INITIALIZATION)) {
        return out_of_order(unit, "ExitInitializationMode");
    }
    begin(unit);
    unit->flight.phase = FMU_STEPPING;
    return FMU_OK;
}

fmu_status fmu_step(fmu *unit, double time, double step)
{
    ampi_command command;
    double *value;
    if ((unit == NULL) || (unit->flight.phase != FMU_STEPPING)) {
        return out_of_order(unit, "DoStep");
    }
    if (!(step > 0.0)) {
        return fmu_fail(unit, "DoStep", "expected a communication step longer than zero");
    }
    value = unit->flight.value;
    command = ampi_guidance_step(&unit->flight.guidance, &unit->table, time, &value[FMU_NAVIGATION],
                                 &value[FMU_SENSED]);
    value[FMU_TIME] = time + step;
    value[FMU_BANK_RATE] = command.bank_rate;
    value[FMU_BANK_ANGLE] = command.bank_angle;
    value[FMU_ANGLE_OF_ATTACK] = command.angle_of_attack;
    value[FMU_STEERING] = (double)command.steering;
    value[FMU_HEALTH] = (double)command.health;
    return FMU_OK;
}

fmu_status fmu_terminate(fmu *unit)
{
    if ((unit == NULL) || (unit->flight.phase != FMU_STEPPING)) {
        return out_of_order(unit, "Terminate");
    }
    unit->flight.phase = FMU_TERMINATED;
    return FMU_OK;
}

fmu_status fmu_reset(fmu *unit)
{
    if (unit == NULL) {
        return FMU_ERROR;
    }
    start(unit);
    return FMU_OK;
}

fmu_status fmu_get_state(const fmu *unit, void **state)
{
    if ((unit == NULL) || (state == NULL)) {
        return FMU_ERROR;
    }
    if (*state == NULL) {
        *state = malloc(sizeof unit->flight);
    }
    if (*state == NULL) {
        return fmu_fail(unit, "GetFMUState", "there is no memory");
    }
    memcpy(*state, &unit->flight, sizeof unit->flight);
    return FMU_OK;
}

fmu_status fmu_set_state(fmu *unit, const void *state)
{
    if (unit == NULL) {
        return FMU_ERROR;
    }
    if (state == NULL) {
        return fmu_fail(unit, "SetFMUState", "expected a state of this FMU, got none");
    }
    memcpy(&unit->flight, state, sizeof unit->flight);
    return FMU_OK;
}

fmu_status fmu_free_state(void **state)
{
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return FMU_OK;
}
