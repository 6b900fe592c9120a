/* What a test asks of the structures of the flight code, so that it need not know their layout. */
#include "ampi_correction.h"
#include "ampi_parts.h"

size_t probe_size(int which)
{
    const size_t sizes[5] = {sizeof(ampi_table), sizeof(ampi_reference), sizeof(ampi_guidance),
                             sizeof(ampi_model), sizeof(ampi_corrector)};
    return sizes[which];
}

const ampi_reference *probe_flown(const ampi_guidance *guidance) { return &guidance->reference; }

/* Low-density rows and the final time; cell and clipped flags; excess; then hole and health. */
void probe_reference(const ampi_table *table, const ampi_reference *reference, double *columns,
                     double *excess, uint32_t *cell, uint32_t *clipped, int32_t *told)
{
    size_t i;
    for (i = 0u; i < table->columns; i++) {
        columns[i] = (double)reference->rows[i];
    }
    for (i = 0u; i < table->n.axes; i++) {
        excess[i] = reference->excess[i];
        cell[i] = reference->cell[i];
        clipped[i] = reference->clipped[i];
    }
    told[0] = (int32_t)reference->hole;
    told[1] = reference->health;
}

void probe_row(const ampi_guidance *guidance, double *row, size_t n)
{
    (void)memcpy(row, guidance->row, n * sizeof *row);
}

/* Flies a recorded flight: navigation [n][8], sensed [n][3], or NULL. */
void probe_fly(ampi_guidance *guidance, const ampi_table *table, size_t n, const double *times,
               const double *navigation, const double *sensed, ampi_command *commands)
{
    size_t i;
    for (i = 0u; i < n; i++) {
        const double *felt = (sensed == NULL) ? NULL : &sensed[3u * i];
        const double *told = (navigation == NULL) ? NULL : &navigation[8u * i];
        commands[i] = ampi_guidance_step(guidance, table, times[i], told, felt);
    }
}
