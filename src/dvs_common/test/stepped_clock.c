/* A wall clock that is off by the seconds in the file STEPPED_CLOCK, for all who load this: reads
   of it, and waits for its instants, which end as the kernel ends them when the clock is set. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

typedef int (*wait_function)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);

static volatile long *offset_s;
static wait_function kernel_wait;

__attribute__((constructor)) static void begin(void) {
    int file = open(getenv("STEPPED_CLOCK"), O_RDONLY);
    if (file >= 0) offset_s = mmap(0, sizeof(long), PROT_READ, MAP_SHARED, file, 0);
    kernel_wait = (wait_function)dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    int result = syscall(SYS_clock_gettime, clock, now);
    if (!result && offset_s && clock == CLOCK_REALTIME) now->tv_sec += *offset_s;
    return result;
}

int gettimeofday(struct timeval *now, void *zone) {
    struct timespec read;
    clock_gettime(CLOCK_REALTIME, &read);
    now->tv_sec = read.tv_sec;
    now->tv_usec = read.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *now) {
    struct timespec read;
    clock_gettime(CLOCK_REALTIME, &read);
    if (now) *now = read.tv_sec;
    return read.tv_sec;
}

int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex, const struct timespec *end) {
    /* Instants of the monotonic clock are years before those of the wall clock. */
    if (end->tv_sec < 1000000000L) return kernel_wait(cond, mutex, end);
    for (;;) {
        struct timespec now, next;
        clock_gettime(CLOCK_REALTIME, &now);
        double left_s = (end->tv_sec - now.tv_sec) + (end->tv_nsec - now.tv_nsec) * 1e-9;
        if (left_s <= 0) return ETIMEDOUT;
        syscall(SYS_clock_gettime, CLOCK_REALTIME, &next);
        next.tv_nsec += (left_s < 0.02 ? left_s : 0.02) * 1e9;
        next.tv_sec += next.tv_nsec / 1000000000L;
        next.tv_nsec %= 1000000000L;
        int result = kernel_wait(cond, mutex, &next);
        if (result != ETIMEDOUT) return result;
    }
}
