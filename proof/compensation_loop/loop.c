/* A controller's loop: every tick one row of a path goes through NAME_compensate of the generated C.

   cc -std=c99 -O2 -DMACHINE=name loop.c name_kin.c -lm -o loop
   ./loop [--free-running] [--period MICROSECONDS] path.csv commands.csv

   path.csv: one header line, then one row a tick: nominal joints in mm and rad, in the order of name_kin.h, and, if
   the machine has drivers and the path logs them, all of those in the order of its NAME_Z_ lines.
   commands.csv: the joints to command. One line of JSON on the standard output: what the ticks took.

   Ticks are released by the monotonic clock; --free-running releases each as soon as the last is done. A tick misses
   its deadline when its command is not there at the next release. Nothing is read, written or allocated
   between the first tick and the last. The clock is POSIX; the rest is C99. */
#define _POSIX_C_SOURCE 200809L

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define TEXT_(a) #a
#define TEXT(a) TEXT_(a)
#include TEXT(JOIN(MACHINE, _kin.h))

#define COMPENSATE JOIN(MACHINE, _compensate)
typedef JOIN(MACHINE, _real) real;
enum { JOINTS = JOIN(MACHINE, _N), DRIVERS = JOIN(MACHINE, _NZ), WIDTH = JOINTS + DRIVERS };

typedef struct {
    long rows;
    int columns; /* JOINTS, or WIDTH where drivers are logged */
    real *cells, *commands;
    long long *took; /* ns a tick */
} path;

typedef struct {
    long missed, refused; /* ticks; those that NAME_compensate could not solve keep the last command */
    long long late;       /* ns from a tick's release to its start, at most */
} outcome;

static long long now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (long long)t.tv_sec * 1000000000LL + t.tv_nsec;
}

static void sleep_until(long long ns)
{
    struct timespec t;
    t.tv_sec = (time_t)(ns / 1000000000LL);
    t.tv_nsec = (long)(ns % 1000000000LL);
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, 0) == EINTR) {
    }
}

static void fail(const char *what, const char *file, long row)
{
    if (row) {
        fprintf(stderr, "error: %s: row %ld: %s\n", file, row, what);
    } else {
        fprintf(stderr, "error: %s: %s\n", file, what);
    }
    exit(2);
}

static void *memory(size_t count, size_t size)
{
    void *place = calloc(count ? count : 1, size);
    if (!place) {
        fail("out of memory", "loop", 0);
    }
    return place;
}

static int cells_of(char *line, real *cells)
{
    char *at = line, *end;
    int k;
    for (k = 0; k <= WIDTH; ++k) {
        const double value = strtod(at, &end);
        if (end == at) {
            return -1;
        }
        if (k < WIDTH) {
            cells[k] = (real)value;
        }
        at = end + strspn(end, " \r\n");
        if (*at != ',') {
            return *at == '\0' ? k + 1 : -1;
        }
        ++at;
    }
    return -1;
}

static path read_path(const char *file)
{
    static char line[65536];
    path p;
    long room = 0;
    FILE *stream = fopen(file, "r");
    memset(&p, 0, sizeof p);
    if (!stream || !fgets(line, sizeof line, stream)) {
        fail("cannot be read, expected a header and rows", file, 0);
    }
    while (fgets(line, sizeof line, stream)) {
        int found;
        if (p.rows == room) {
            room = 2 * room + 1024;
            p.cells = realloc(p.cells, (size_t)room * WIDTH * sizeof(real));
            if (!p.cells) {
                fail("out of memory", file, 0);
            }
        }
        found = cells_of(line, p.cells + p.rows * WIDTH);
        if ((found != JOINTS && found != WIDTH) || (p.rows && found != p.columns)) {
            fail("expected numbers: the joints, or the joints and every driver", file, p.rows + 1);
        }
        p.columns = found;
        ++p.rows;
    }
    fclose(stream);
    if (!p.rows) {
        fail("found no row", file, 0);
    }
    p.commands = memory((size_t)p.rows * JOINTS, sizeof(real));
    p.took = memory((size_t)p.rows, sizeof(long long));
    return p;
}

static outcome run(const path *p, long long period, int free_running)
{
    outcome out = { 0, 0, 0 };
    real q[JOINTS];
    long k;
    long long release = now() + period;
    memcpy(q, p->cells, sizeof q);
    for (k = 0; k < p->rows; ++k, release += period) {
        const real *row = p->cells + k * WIDTH;
        const real *z = p->columns > JOINTS ? row + JOINTS : 0;
        long long start, end;
        if (!free_running) {
            sleep_until(release);
        }
        start = now();
        out.refused += COMPENSATE(0, z, row, q) != 0; /* on a refusal q stays as it was */
        end = now();
        memcpy(p->commands + k * JOINTS, q, sizeof q); /* here a controller would send q to its drives */
        p->took[k] = end - start;
        if (!free_running) {
            out.missed += end > release + period;
            out.late = start - release > out.late ? start - release : out.late;
        }
    }
    return out;
}

static void write_commands(const path *p, const char *file)
{
    FILE *stream = fopen(file, "w");
    long k;
    int j;
    if (!stream) {
        fail("cannot be written", file, 0);
    }
    for (j = 0; j < JOINTS; ++j) {
        fprintf(stream, "q%d%c", j + 1, j + 1 < JOINTS ? ',' : '\n');
    }
    for (k = 0; k < p->rows; ++k) {
        for (j = 0; j < JOINTS; ++j) {
            fprintf(stream, "%.17g%c", (double)p->commands[k * JOINTS + j], j + 1 < JOINTS ? ',' : '\n');
        }
    }
    if (fclose(stream) != 0) {
        fail("cannot be written", file, 0);
    }
}

static int ascending(const void *a, const void *b)
{
    const long long x = *(const long long *)a, y = *(const long long *)b;
    return (x > y) - (x < y);
}

static void report(const path *p, const outcome *out, long long period, int free_running)
{
    double sum = 0.0;
    long k;
    for (k = 0; k < p->rows; ++k) {
        sum += (double)p->took[k];
    }
    qsort(p->took, (size_t)p->rows, sizeof *p->took, ascending);
    printf("{\"ticks\": %ld, \"refused\": %ld, \"compute_us\": {\"mean\": %.3f, \"p99.9\": %.3f, \"max\": %.3f}", p->rows,
        out->refused, sum / (double)p->rows / 1e3, (double)p->took[(p->rows - 1) - (p->rows - 1) / 1000] / 1e3,
        (double)p->took[p->rows - 1] / 1e3);
    if (!free_running) {
        printf(", \"period_us\": %.3f, \"missed\": %ld, \"latest_start_us\": %.3f", (double)period / 1e3, out->missed,
            (double)out->late / 1e3);
    }
    printf("}\n");
}

int main(int count, char **arguments)
{
    long long period = 1000000;
    int free_running = 0, k = 1;
    path p;
    outcome out;
    for (; k < count && strncmp(arguments[k], "--", 2) == 0; ++k) {
        if (strcmp(arguments[k], "--free-running") == 0) {
            free_running = 1;
        } else if (strcmp(arguments[k], "--period") == 0 && k + 1 < count) {
            period = 1000 * strtoll(arguments[++k], 0, 10);
        } else {
            break;
        }
    }
    if (count - k != 2 || period <= 0) {
        fprintf(stderr, "usage: %s [--free-running] [--period MICROSECONDS] path.csv commands.csv\n", arguments[0]);
        return 2;
    }
    p = read_path(arguments[k]);
    out = run(&p, period, free_running);
    write_commands(&p, arguments[k + 1]);
    report(&p, &out, period, free_running);
    free(p.cells);
    free(p.commands);
    free(p.took);
    return out.refused ? 1 : 0;
}
