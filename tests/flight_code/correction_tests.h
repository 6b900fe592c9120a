/* What the own tests of estimation and correction share. */
#ifndef CORRECTION_TESTS_H
#define CORRECTION_TESTS_H

#include "ampi_correction_parts.h"

/* Counts; ends the program where it is not met. */
void expect(int is_met, const char *what, double told, double expected);

/* Flies, and writes what is planned to `path`. */
void test_flights(const ampi_model *model, const ampi_table *table, const char *path);

#endif
