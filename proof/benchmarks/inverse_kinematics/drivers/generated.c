/* Times the generated C of one machine over a file of poses.

   driver MODE POSES GUESSES OUT REPEATS; MODE: one (NAME_ik a pose), batch (NAME_ik_n), all (NAME_ik_all).
   POSES: rows of 12 doubles, GUESSES: rows of N doubles. Prints one line a repeat, the seconds of processor time a
   pose; OUT gets, a pose, N doubles (mode all: a count and BRANCHES * N) and a return code in front.
   Compiled with -DMACHINE=name -DKIN="name_kin.h", and -DBATCH="name_batch.h" or -DHAS_ALL where they exist. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include KIN
#ifdef BATCH
#include BATCH
#endif

#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define OF(what) JOIN(MACHINE, what)

typedef OF(real) real;
enum { N = OF(N) };
#ifdef HAS_ALL
enum { WIDTH = 1 + OF(BRANCHES) * N };
#else
enum { WIDTH = N };
#endif

typedef struct {
    int n;
    real *T, *guess, *q;
    int *code;
} work;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void *need(size_t count, size_t size)
{
    void *memory = calloc(count + 1, size);
    if (!memory) {
        exit(2);
    }
    return memory;
}

/* The numbers of a file, rounded to the machine's type; *count is how many. */
static real *load(const char *path, size_t *count)
{
    FILE *file = fopen(path, "rb");
    long bytes;
    double *wide;
    real *numbers;
    size_t i;
    if (!file || fseek(file, 0, SEEK_END) != 0 || (bytes = ftell(file)) < 0) {
        exit(2);
    }
    rewind(file);
    *count = (size_t)bytes / sizeof(double);
    wide = need(*count, sizeof(double));
    numbers = need(*count, sizeof(real));
    if (fread(wide, sizeof(double), *count, file) != *count) {
        exit(2);
    }
    fclose(file);
    for (i = 0; i < *count; ++i) {
        numbers[i] = (real)wide[i];
    }
    free(wide);
    return numbers;
}

static void save(const char *path, const work *w, int width)
{
    FILE *file = fopen(path, "wb");
    int i, j;
    if (!file) {
        exit(2);
    }
    for (i = 0; i < w->n; ++i) {
        double row[1 + WIDTH];
        row[0] = (double)w->code[i];
        for (j = 0; j < width; ++j) {
            row[1 + j] = (double)w->q[i * width + j];
        }
        if (fwrite(row, sizeof(double), (size_t)(1 + width), file) != (size_t)(1 + width)) {
            exit(2);
        }
    }
    fclose(file);
}

static void one(const work *w)
{
    int i;
    for (i = 0; i < w->n; ++i) {
        w->code[i] = OF(ik)(NULL, NULL, w->T + 12 * i, w->guess + N * i, w->q + N * i);
    }
}

#ifdef BATCH
static void batch(const work *w)
{
    (void)OF(ik_n)(NULL, NULL, w->n, w->T, w->guess, w->q, w->code);
}
#endif

#ifdef HAS_ALL
static void all(const work *w)
{
    int i;
    for (i = 0; i < w->n; ++i) {
        real *row = w->q + (size_t)WIDTH * (size_t)i;
        int count = 0;
        w->code[i] = OF(ik_all)(NULL, NULL, w->T + 12 * i, row + 1, &count);
        row[0] = (real)count;
    }
}
#endif

int main(int argc, char **argv)
{
    work w;
    size_t numbers, guesses;
    int repeat, width = N;
    void (*run)(const work *) = one;
    if (argc != 6) {
        return 2;
    }
#ifdef BATCH
    run = strcmp(argv[1], "batch") == 0 ? batch : run;
#endif
#ifdef HAS_ALL
    run = strcmp(argv[1], "all") == 0 ? all : run;
    width = run == all ? WIDTH : N;
#endif
    w.T = load(argv[2], &numbers);
    w.guess = load(argv[3], &guesses);
    w.n = (int)(numbers / 12);
    if (guesses != (size_t)N * (size_t)w.n) {
        return 2;
    }
    w.q = need((size_t)width * (size_t)w.n, sizeof(real));
    w.code = need((size_t)w.n, sizeof(int));
    for (repeat = 0; repeat < atoi(argv[5]); ++repeat) {
        const double start = now();
        run(&w);
        printf("%.6e\n", (now() - start) / (double)w.n);
    }
    save(argv[4], &w, width);
    return 0;
}
