/* Breaks one call of a program, for tests: cc -shared -fPIC faults.c -o faults.so, and LD_PRELOAD=faults.so.
 *
 * Calls that change files under the folder FAULT_FOLDER are counted, from 1. With FAULT_AT=n, the n-th
 *   FAULT=short     writes half of what it should and says so,
 *   FAULT=enospc    fails as on a full disk,
 *   FAULT=full      fails as on a full disk, and so do all later ones that need room,
 *   FAULT=eio       fails as on a broken disk,
 *   FAULT=kill      does not happen: the program is killed before,
 *   FAULT=tear      writes half, then the program is killed.
 * The number of calls, and the call that was broken, are in the file FAULT_REPORT, one line a call. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { SHORT = 1, NO_ROOM, FULL, BROKEN, KILL, TEAR };

static atomic_long calls;

static long setting(const char *name) {
    const char *text = getenv(name);
    return text ? atol(text) : 0;
}

static int fault(void) {
    static const char *const words[] = {"", "short", "enospc", "full", "eio", "kill", "tear"};
    const char *word = getenv("FAULT");
    for (int kind = SHORT; word && kind <= TEAR; kind++)
        if (!strcmp(word, words[kind])) return kind;
    return 0;
}

/* The system's own calls: those of the library are replaced below. */
static void report(const char *call, const char *path, long number, int broken) {
    char line[PATH_MAX + 64];
    const char *to = getenv("FAULT_REPORT");
    if (!to) return;
    int length = snprintf(line, sizeof line, "%ld %s %s%s\n", number, call, path, broken ? " broken" : "");
    int fd = (int)syscall(SYS_openat, AT_FDCWD, to, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (fd < 0) return;
    syscall(SYS_write, fd, line, length);
    syscall(SYS_close, fd);
}

static int is_inside(const char *path) {
    const char *folder = getenv("FAULT_FOLDER");
    size_t length = folder ? strlen(folder) : 0;
    return length && !strncmp(path, folder, length) && (path[length] == '/' || !path[length]);
}

/* What is to happen to a call: 0 nothing, or a fault. Kills before calls that cannot be done by halves. */
static int counted(const char *call, const char *path, int needs_room, int has_halves) {
    if (!is_inside(path)) return 0;
    long number = atomic_fetch_add(&calls, 1) + 1, at = setting("FAULT_AT");
    int kind = at ? fault() : 0;
    int hit = kind == FULL ? number >= at && needs_room : kind && number == at;
    report(call, path, number, hit);
    if (!hit) return 0;
    if (kind == KILL || (kind == TEAR && !has_halves)) raise(SIGKILL);
    return kind;
}

static int counted_fd(const char *call, int fd, int needs_room, int has_halves) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length <= 0) return 0;
    path[length] = 0;
    return counted(call, path, needs_room, has_halves);
}

static int error_of(int kind) { return kind == BROKEN ? EIO : ENOSPC; }

#define REAL(type, name, ...) ((type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, name))

/* A write by `real(amount)`, with what is to happen to it. */
#define WRITE(call, fd, all, half, real)                                  \
    do {                                                                  \
        int kind = counted_fd(call, fd, 1, 1);                            \
        if (kind == NO_ROOM || kind == FULL || kind == BROKEN) {          \
            errno = error_of(kind);                                       \
            return -1;                                                    \
        }                                                                 \
        ssize_t written = real(kind ? (half) : (all));                  \
        if (kind == TEAR) raise(SIGKILL);                                 \
        return written;                                                   \
    } while (0)

ssize_t write(int fd, const void *bytes, size_t size) {
#define DO(n) REAL(ssize_t, "write", int, const void *, size_t)(fd, bytes, n)
    WRITE("write", fd, size, (size + 1) / 2, DO);
#undef DO
}

ssize_t pwrite64(int fd, const void *bytes, size_t size, off64_t at) {
#define DO(n) REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t)(fd, bytes, n, at)
    WRITE("pwrite", fd, size, (size + 1) / 2, DO);
#undef DO
}

ssize_t pwrite(int fd, const void *bytes, size_t size, off_t at) { return pwrite64(fd, bytes, size, at); }

ssize_t writev(int fd, const struct iovec *parts, int count) {
    /* Half of it: without the other parts, or half of the only one. */
    struct iovec half = {parts[0].iov_base, count > 1 ? parts[0].iov_len : (parts[0].iov_len + 1) / 2};
#define DO(n) REAL(ssize_t, "writev", int, const struct iovec *, int)(fd, (n) ? parts : &half, (n) ? count : 1)
    WRITE("writev", fd, 1, 0, DO);
#undef DO
}

ssize_t copy_file_range(int from, off64_t *from_at, int to, off64_t *to_at, size_t size, unsigned flags) {
#define DO(n)                                                                           \
    REAL(ssize_t, "copy_file_range", int, off64_t *, int, off64_t *, size_t, unsigned) \
    (from, from_at, to, to_at, n, flags)
    /* Programs ask for more than there is; this is less than any cache. */
    WRITE("copy", to, size, 4096, DO);
#undef DO
}

/* Calls that are done or not. Those that free room do not fail for want of it. */
#define WHOLE(happens, real)                                   \
    do {                                                       \
        int kind = happens;                                    \
        if (kind == NO_ROOM || kind == FULL || kind == BROKEN) { \
            errno = error_of(kind);                            \
            return -1;                                         \
        }                                                      \
        return real;                                           \
    } while (0)

int fsync(int fd) { WHOLE(counted_fd("fsync", fd, 1, 0), REAL(int, "fsync", int)(fd)); }

int fdatasync(int fd) { WHOLE(counted_fd("fdatasync", fd, 1, 0), REAL(int, "fdatasync", int)(fd)); }

int ftruncate64(int fd, off64_t size) {
    WHOLE(counted_fd("ftruncate", fd, 1, 0), REAL(int, "ftruncate64", int, off64_t)(fd, size));
}

int ftruncate(int fd, off_t size) { return ftruncate64(fd, size); }

int rename(const char *from, const char *to) {
    WHOLE(counted("rename", to, 1, 0), REAL(int, "rename", const char *, const char *)(from, to));
}

int unlink(const char *path) { WHOLE(counted("unlink", path, 0, 0), REAL(int, "unlink", const char *)(path)); }

int linkat(int from_folder, const char *from, int to_folder, const char *to, int flags) {
    WHOLE(counted("link", to, 1, 0),
          REAL(int, "linkat", int, const char *, int, const char *, int)(from_folder, from, to_folder, to, flags));
}

int mkdir(const char *path, mode_t mode) {
    WHOLE(counted("mkdir", path, 1, 0), REAL(int, "mkdir", const char *, mode_t)(path, mode));
}

/* Opening counts when it may make or empty a file. */
int open64(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    WHOLE(flags & (O_CREAT | O_TRUNC) ? counted("open", path, 1, 0) : 0,
          REAL(int, "open64", const char *, int, ...)(path, flags, mode));
}

int open(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return open64(path, flags, mode);
}
