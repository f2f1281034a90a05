/* A test program's start on a Cortex-M with a floating point unit, what it says to the emulator, and the watch
   over one call. The linker script gives data_*, bss_*, stack_* and timer. */
    .syntax unified
    .thumb

    .equ    MARK, 0xa5c35a3c

    .section .vectors, "a"
    .word   stack_top
    .word   reset
    .rept   14
    .word   fault
    .endr

    .text

    .global reset
    .thumb_func
    .type   reset, %function
reset:
    ldr     r0, =0xe000ed88         @ CPACR: full access to the floating point unit
    ldr     r1, [r0]
    orr     r1, r1, #0xf00000
    str     r1, [r0]
    dsb
    isb
    ldr     r0, =data_start
    ldr     r1, =data_end
    ldr     r2, =data_load
1:  cmp     r0, r1
    bhs     2f
    ldr     r3, [r2], #4
    str     r3, [r0], #4
    b       1b
2:  ldr     r0, =bss_start
    ldr     r1, =bss_end
    movs    r3, #0
3:  cmp     r0, r1
    bhs     4f
    str     r3, [r0], #4
    b       3b
4:  ldr     r0, =timer              @ 32 bits, counting down, without interrupts
    mvn     r1, #0
    str     r1, [r0, #8]
    str     r1, [r0, #4]
    movs    r1, #1
    str     r1, [r0]
    bl      main
    b       leave

    .thumb_func
    .type   fault, %function
fault:
    ldr     r0, =stack_top          @ the stack may be what failed
    mov     sp, r0
    adr     r0, fault_text
    bl      say
    movs    r0, #70
    b       leave
    .balign 4
fault_text:
    .asciz  "fault\n"
    .balign 4

/* void say(const char *text): SYS_WRITE0 */
    .global say
    .thumb_func
    .type   say, %function
say:
    mov     r1, r0
    movs    r0, #0x04
    bkpt    0xab
    bx      lr

/* void leave(int code): SYS_EXIT_EXTENDED */
    .thumb_func
    .type   leave, %function
leave:
    ldr     r1, =0x20026            @ the application's own exit
    push    {r1, r2}
    str     r0, [sp, #4]
    mov     r1, sp
    movs    r0, #0x20
    bkpt    0xab
    b       .

/* int observe(function, const void *const arguments[5], observation *seen)
   Calls function(arguments[0] ... arguments[4]) and returns what it returns. seen[0]: ticks of the timer, from the
   branch to the first instruction after it. seen[1]: bytes of stack below this frame down to the lowest word written;
   the whole stack was painted before. */
    .global observe
    .thumb_func
    .type   observe, %function
observe:
    push    {r4-r10, lr}
    sub     sp, #8
    mov     r4, r0
    mov     r5, r1
    mov     r6, r2
    ldr     r0, [r5, #16]
    str     r0, [sp]                @ the fifth argument
    ldr     r0, =stack_limit
    ldr     r1, =MARK
    mov     r2, sp
1:  cmp     r0, r2
    bhs     2f
    str     r1, [r0], #4
    b       1b
2:  ldr     r7, =timer
    ldm     r5, {r0-r3}
    ldr     r8, [r7, #4]
    blx     r4
    ldr     r1, [r7, #4]
    sub     r8, r8, r1
    str     r8, [r6]
    ldr     r1, =stack_limit
    ldr     r2, =MARK
3:  ldr     r3, [r1], #4            @ ends at this frame at the latest
    cmp     r3, r2
    beq     3b
    subs    r1, #4
    mov     r2, sp
    subs    r2, r2, r1
    str     r2, [r6, #4]
    add     sp, #8
    pop     {r4-r10, pc}

/* Calls whose cost is known: 1 instruction; 5, one of them skipped, which counts; 2 * turns + 2; 4 * words bytes of
   stack and 3 * words + 4 instructions. */
    .global nothing
    .thumb_func
    .type   nothing, %function
nothing:
    bx      lr

    .global skip
    .thumb_func
    .type   skip, %function
skip:
    movs    r0, #0
    cmp     r0, #1
    it      eq
    moveq   r0, #1
    bx      lr

    .global turn
    .thumb_func
    .type   turn, %function
turn:
    ldr     r0, [r0]
1:  subs    r0, #1
    bne     1b
    bx      lr

    .global dig
    .thumb_func
    .type   dig, %function
dig:
    ldr     r0, [r0]
    mov     r1, sp
1:  push    {r0}
    subs    r0, #1
    bne     1b
    mov     sp, r1
    bx      lr

    .ltorg
