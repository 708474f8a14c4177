// Faults of a disk, below one folder: loaded before libc (LD_PRELOAD), counted over all processes that share FAULT_COUNTER.
//
// FAULT_FOLDER   only files below it
// FAULT_COUNTER  file of 16 bytes: calls so far, bytes written so far
// FAULT_CALL     the number of the call that fails, from 0; -1: none
// FAULT_ERRNO    with this number
// FAULT_BYTES    room on the disk: what goes beyond fails with ENOSPC; -1: no end
// FAULT_HANG      1: the disk does not answer, no call comes back within half a minute
// FAULT_SHORT    1: every read and write moves one byte less than asked, where it is of more than one
// FAULT_CLOCK    1: the time of day jumps by a day, back and forth, at every look
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define REAL(name) ((__typeof__(&name))find(&real_##name, #name))
#define DECLARE(name) static void *real_##name

static void *find(void **place, const char *name) {
    if (!*place) *place = dlsym(RTLD_NEXT, name);
    return *place;
}

DECLARE(open); DECLARE(open64); DECLARE(openat); DECLARE(openat64); DECLARE(close); DECLARE(read); DECLARE(write);
DECLARE(pread64); DECLARE(pwrite64); DECLARE(writev); DECLARE(readv); DECLARE(fsync); DECLARE(fdatasync); DECLARE(rename);
DECLARE(unlink); DECLARE(unlinkat); DECLARE(rmdir); DECLARE(mkdir); DECLARE(link); DECLARE(linkat); DECLARE(opendir);
DECLARE(statx); DECLARE(ftruncate64); DECLARE(clock_gettime);

static char folder[PATH_MAX];
static size_t folder_length;
static long fail_at = -1, room = -1;
static int fail_with = EIO, is_short, is_clock, hangs;
static _Atomic int64_t *counters; // calls, bytes
static _Atomic unsigned char tracked[1 << 16];

__attribute__((constructor)) static void begin(void) {
    const char *at = getenv("FAULT_FOLDER"), *counter = getenv("FAULT_COUNTER"), *text;
    if ((text = getenv("FAULT_CLOCK"))) is_clock = atoi(text);
    if (!at || !counter) return;
    if ((text = getenv("FAULT_CALL"))) fail_at = atol(text);
    if ((text = getenv("FAULT_ERRNO"))) fail_with = atoi(text);
    if ((text = getenv("FAULT_BYTES"))) room = atol(text);
    if ((text = getenv("FAULT_SHORT"))) is_short = atoi(text);
    if ((text = getenv("FAULT_HANG"))) hangs = atoi(text);
    int fd = REAL(open)(counter, O_RDWR);
    if (fd < 0) return;
    void *shared = mmap(NULL, 16, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    REAL(close)(fd);
    if (shared == MAP_FAILED) return;
    counters = shared;
    snprintf(folder, sizeof folder, "%s", at);
    folder_length = strlen(folder);
}

static int is_below(const char *path) {
    return counters && path && strncmp(path, folder, folder_length) == 0
        && (path[folder_length] == '/' || path[folder_length] == 0);
}

// Whether this call is the one that fails; errno is set then.
static int fails(void) {
    int64_t call = atomic_fetch_add(&counters[0], 1);
    if (hangs) sleep(30);
    if (call != fail_at) return 0;
    errno = fail_with;
    return 1;
}

static int is_tracked(int fd) { return counters && fd >= 0 && fd < (1 << 16) && tracked[fd]; }

static int track(int fd) {
    if (fd >= 0 && fd < (1 << 16)) tracked[fd] = 1;
    return fd;
}

// Whether so many bytes more are beyond the room.
static int is_full(size_t n) {
    int64_t sum = atomic_fetch_add(&counters[1], (int64_t)n) + (int64_t)n;
    if (room < 0 || sum <= room) return 0;
    errno = ENOSPC;
    return 1;
}

#define OPEN(name)                                                                                                   \
    int name(const char *path, int flags, ...) {                                                                     \
        __builtin_va_list list;                                                                                      \
        __builtin_va_start(list, flags);                                                                             \
        mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) ? __builtin_va_arg(list, mode_t) : 0;                        \
        __builtin_va_end(list);                                                                                      \
        if (!is_below(path)) return REAL(name)(path, flags, mode);                                                   \
        return fails() ? -1 : track(REAL(name)(path, flags, mode));                                                  \
    }
#define OPENAT(name)                                                                                                 \
    int name(int at, const char *path, int flags, ...) {                                                             \
        __builtin_va_list list;                                                                                      \
        __builtin_va_start(list, flags);                                                                             \
        mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) ? __builtin_va_arg(list, mode_t) : 0;                        \
        __builtin_va_end(list);                                                                                      \
        if (!is_below(path) && !is_tracked(at)) return REAL(name)(at, path, flags, mode);                            \
        return fails() ? -1 : track(REAL(name)(at, path, flags, mode));                                              \
    }
OPEN(open)
OPEN(open64)
OPENAT(openat)
OPENAT(openat64)

int close(int fd) {
    if (fd >= 0 && fd < (1 << 16)) tracked[fd] = 0;
    return REAL(close)(fd);
}

static size_t part(size_t n) { return is_short && n > 1 ? n - 1 : n; }

ssize_t read(int fd, void *to, size_t n) {
    if (!is_tracked(fd)) return REAL(read)(fd, to, n);
    return fails() ? -1 : REAL(read)(fd, to, part(n));
}

ssize_t pread64(int fd, void *to, size_t n, off64_t at) {
    if (!is_tracked(fd)) return REAL(pread64)(fd, to, n, at);
    return fails() ? -1 : REAL(pread64)(fd, to, part(n), at);
}

ssize_t readv(int fd, const struct iovec *parts, int n) {
    if (is_tracked(fd) && fails()) return -1;
    return REAL(readv)(fd, parts, n);
}

ssize_t write(int fd, const void *from, size_t n) {
    if (!is_tracked(fd)) return REAL(write)(fd, from, n);
    return fails() || is_full(part(n)) ? -1 : REAL(write)(fd, from, part(n));
}

ssize_t pwrite64(int fd, const void *from, size_t n, off64_t at) {
    if (!is_tracked(fd)) return REAL(pwrite64)(fd, from, n, at);
    return fails() || is_full(part(n)) ? -1 : REAL(pwrite64)(fd, from, part(n), at);
}

ssize_t writev(int fd, const struct iovec *parts, int n) {
    size_t sum = 0;
    for (int i = 0; i < n; i++) sum += parts[i].iov_len;
    if (is_tracked(fd) && (fails() || is_full(sum))) return -1;
    return REAL(writev)(fd, parts, n);
}

int fsync(int fd) { return is_tracked(fd) && fails() ? -1 : REAL(fsync)(fd); }
int fdatasync(int fd) { return is_tracked(fd) && fails() ? -1 : REAL(fdatasync)(fd); }
int ftruncate64(int fd, off64_t n) { return is_tracked(fd) && fails() ? -1 : REAL(ftruncate64)(fd, n); }
int rename(const char *from, const char *to) { return is_below(to) && fails() ? -1 : REAL(rename)(from, to); }
int unlink(const char *path) { return is_below(path) && fails() ? -1 : REAL(unlink)(path); }
int unlinkat(int at, const char *path, int flags) {
    return (is_tracked(at) || is_below(path)) && fails() ? -1 : REAL(unlinkat)(at, path, flags);
}
int rmdir(const char *path) { return is_below(path) && fails() ? -1 : REAL(rmdir)(path); }
int mkdir(const char *path, mode_t mode) { return is_below(path) && fails() ? -1 : REAL(mkdir)(path, mode); }
int link(const char *from, const char *to) { return is_below(to) && fails() ? -1 : REAL(link)(from, to); }
int linkat(int a, const char *from, int b, const char *to, int flags) {
    return is_below(to) && fails() ? -1 : REAL(linkat)(a, from, b, to, flags);
}
DIR *opendir(const char *path) { return is_below(path) && fails() ? NULL : REAL(opendir)(path); }
// Programs ask with no path at all whether the call is there.
static int is_empty(const char *volatile path) { return path && !*path; }

int statx(int at, const char *restrict path, int flags, unsigned mask, struct statx *restrict to) {
    return (is_below(path) || (is_empty(path) && is_tracked(at))) && fails() ? -1 : REAL(statx)(at, path, flags, mask, to);
}

int clock_gettime(clockid_t which, struct timespec *to) {
    static _Atomic int n;
    int answer = REAL(clock_gettime)(which, to);
    if (is_clock && answer == 0 && which == CLOCK_REALTIME && atomic_fetch_add(&n, 1) % 2) to->tv_sec -= 86400;
    return answer;
}
