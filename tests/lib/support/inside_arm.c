/* What is static in the C of a six-joint arm, for tests: compiled with -DFILE_OF_ARM="NAME_kin.c",
   and -DNO_DRAWN_ARM where none with a closed form is similar. */
#include FILE_OF_ARM

#ifndef NO_DRAWN_ARM
/* Solutions of the drawn arm at T, at most 8 rows of q. */
int starts_at(const real *T, real *q)
{
    manner how = { 0, 0, 0, 0, 0 };
    return drawn_solutions(&how, T, (real(*)[6])q);
}
#endif

void sines_and_cosines(int n, const real *angle, real *sine, real *cosine)
{
    int k;
    for (k = 0; k < n; ++k) {
        sin_cos(angle[k], sine + k, cosine + k);
    }
}
