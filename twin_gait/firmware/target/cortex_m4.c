/* Machine of the main loop: QEMU's mps2-an386 with a Cortex-M4F, semihosting and a timer. */
#include <string.h>

#include "loop.h"

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT_EXTENDED = 0x20 };
enum { OPEN_READ_BINARY = 1, OPEN_WRITE_BINARY = 5, APPLICATION_EXIT = 0x20026, FAULT = 70, OVERFLOW = 71 };

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define TIMER_CONTROL REGISTER(0x40000000) /* CMSDK APB timer 0, counts down at 25 MHz */
#define TIMER_VALUE REGISTER(0x40000004)
#define TIMER_RELOAD REGISTER(0x40000008)
#define COPROCESSORS REGISTER(0xE000ED88) /* CPACR of ARMv7-M */

extern uint32_t data_start[], data_end[], data_image[], bss_start[], bss_end[], stack_start[], stack_end[];
Step step_of_1, step_of_1002, step_of_100002; /* clock.S */
int main(void);

static int32_t semihosting(uint32_t operation, const uint32_t *arguments) {
    register uint32_t r0 __asm("r0") = operation;
    register const uint32_t *r1 __asm("r1") = arguments;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return (int32_t)r0;
}

__attribute__((noreturn)) static void leave(uint32_t status) {
    for (;;) {
        (void)semihosting(SYS_EXIT_EXTENDED, (const uint32_t[]){APPLICATION_EXIT, status});
    }
}

static void fault(void) { leave(FAULT); }

static uint32_t bytes_between(const void *first, const void *end) { return (uint32_t)end - (uint32_t)first; }

/* The first code that runs; it uses no floating-point numbers before their unit is enabled. */
__attribute__((noreturn)) void reset(void) {
    COPROCESSORS |= 0xFu << 20;
    __asm volatile("dsb\n isb");
    (void)memcpy(data_start, data_image, bytes_between(data_start, data_end));
    (void)memset(bss_start, 0, bytes_between(bss_start, bss_end));
    leave((uint32_t)main());
}

/* Stack, reset, and the faults from NMI to usage fault; no interrupt is enabled. */
__attribute__((section(".vectors"), used)) static const void *const vectors[] = {
    stack_end, (void *)reset, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault,
};

static uint32_t input, output;

static uint32_t open(const char *path, uint32_t length, uint32_t mode) {
    return (uint32_t)semihosting(SYS_OPEN, (const uint32_t[]){(uint32_t)path, mode, length});
}

void open_channel(uint32_t calibration[CALIBRATION]) {
    static Step *const steps[CALIBRATION] = {step_of_1, step_of_1002, step_of_100002};
    TIMER_RELOAD = UINT32_MAX;
    TIMER_VALUE = UINT32_MAX;
    TIMER_CONTROL = 1;
    for (int32_t i = 0; i < CALIBRATION; i++) {
        calibration[i] = clocked(steps[i], 0, 0, 0);
    }
    input = open("/dev/stdin", 10, OPEN_READ_BINARY);
    output = open("/dev/stdout", 11, OPEN_WRITE_BINARY);
}

/* Repeat a call until no bytes are left to move; it returns the number left, and all of them at the end of a stream. */
static bool move(uint32_t operation, uint32_t file, uint32_t address, uint32_t size) {
    while (size > 0) {
        const int32_t left = semihosting(operation, (const uint32_t[]){file, address, size});
        if (left < 0 || (uint32_t)left >= size) {
            return false;
        }
        address += size - (uint32_t)left;
        size = (uint32_t)left;
    }
    return true;
}

bool receive(void *bytes, uint32_t size) { return move(SYS_READ, input, (uint32_t)bytes, size); }

void transmit(const void *bytes, uint32_t size) {
    if (!move(SYS_WRITE, output, (uint32_t)bytes, size)) {
        leave(1);
    }
}

enum { MARK = 0x5AFE57AC };

void mark_stack(void) {
    const uint32_t words = bytes_between(stack_start, __builtin_frame_address(0)) / 4; /* all words below are free */
    for (uint32_t i = 0; i < words; i++) {
        stack_start[i] = MARK;
    }
}

uint32_t stack_bytes(void) {
    const uint32_t words = bytes_between(stack_start, stack_end) / 4;
    uint32_t unused = 0;
    while (unused < words && stack_start[unused] == MARK) {
        unused++;
    }
    if (unused == 0) {
        leave(OVERFLOW);
    }
    return 4 * (words - unused);
}
