//! What the C library's allocator does with freed memory.

/// Lets the allocator keep freed memory in place of giving it back to the system, and all threads take from
/// one store: a training step, and the inference of a sample, ask for the same megabytes as the one before, and
/// clearing fresh pages took a fifth of their time.
///
/// Does nothing where the C library is not glibc, of which older versions take no higher threshold than 32 MiB.
pub fn keep_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (option, value) in [
        (libc::M_MMAP_THRESHOLD, 32 << 20),
        (libc::M_MMAP_THRESHOLD, 1 << 30),
        (libc::M_TRIM_THRESHOLD, i32::MAX),
        (libc::M_ARENA_MAX, 1),
    ] {
        // SAFETY: `mallopt` takes two integers and locks the allocator's state itself; an unknown option or
        // a value out of range is refused and changes nothing.
        unsafe { libc::mallopt(option, value) };
    }
}
