/* The clock around a step, and steps of known length to calibrate it: instructions that a compiler may not change. */
    .syntax unified
    .thumb
    .equ TIMER_VALUE, 0x40000004

/* uint32_t clocked(Step *step, Unit *, const Inputs *, Outputs *): difference of two readings of a timer that counts
   down. Between them are a call, the step and its return; the call is part of the calibration, too, and cancels. */
    .text
    .global clocked
    .thumb_func
clocked:
    push {r4, r5, r6, lr}
    mov r6, r0
    mov r0, r1
    mov r1, r2
    mov r2, r3
    ldr r4, =TIMER_VALUE
    ldr r5, [r4]
    blx r6
    ldr r4, [r4]
    subs r0, r5, r4
    pop {r4, r5, r6, pc}
    .ltorg

    .global step_of_1
    .thumb_func
step_of_1:
    bx lr

    .macro countdown name, turns /* 2 + 2 turns instructions */
    .global \name
    .thumb_func
\name:
    movw r0, #\turns
1:  subs r0, r0, #1
    bne 1b
    bx lr
    .endm

    countdown step_of_1002, 500
    countdown step_of_100002, 50000
