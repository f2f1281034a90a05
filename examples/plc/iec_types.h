/* IEC 61131-3's elementary types in C. A stand-in: where the controller's maker has a header for them (bur/plctypes.h,
   CmpStd.h, TcDef.h), include that instead. */
#ifndef IEC_TYPES_H
#define IEC_TYPES_H

#include <stdint.h>

typedef uint8_t BOOL; /* one byte, 0 or 1 */
typedef int32_t DINT;
typedef uint32_t UDINT;
typedef float REAL;
typedef double LREAL;

#define FALSE ((BOOL)0)
#define TRUE ((BOOL)1)

#endif
