"""Tasks on a grid, each after its neighbours on the left and above, shared by CPU threads.

A thread that is done with a task goes on with the one below, and leaves the one on the right, if it
may begin, to whoever asks next: so nobody waits while there is anything to do, even where other
work of the machine takes a thread off its core.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# What the threads share, in one array of STATE + 2 rows columns integers: a lock, the number of
# tasks that are left, the number of those that may begin; then a stack of the latter; then of each
# task how many of its neighbours it still waits for.
STATE = 16

_LOCK = """
    int* const shared = tasks.data;
    #if defined(__x86_64__)
    #define PAUSE __builtin_ia32_pause()
    #elif defined(__aarch64__)
    #define PAUSE __asm__ volatile("yield")
    #else
    #define PAUSE
    #endif
    #define LOCK while (__atomic_exchange_n(shared, 1, __ATOMIC_ACQUIRE)) PAUSE
    #define UNLOCK __atomic_store_n(shared, 0, __ATOMIC_RELEASE)
    int* const left = shared + 1;
    int* const count = shared + 2;
    int* const ready = shared + STATE;
    int* const waits = ready + rows * columns;
""".replace("STATE", str(STATE))


@wp.func_native(
    _LOCK
    + """
    shared[0] = 0;
    *left = rows * columns;
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c) waits[r * columns + c] = (r > 0) + (c > 0);
    ready[0] = 0;
    *count = 1;
"""
)
def plan_tasks(rows: int, columns: int, tasks: wp.array[int]):
    """Begin anew: only the task in the corner may begin."""


@wp.func_native(
    _LOCK
    + """
    for (;;) {
        const int none_left = __atomic_load_n(left, __ATOMIC_ACQUIRE) == 0;
        if (none_left) return -1;
        if (__atomic_load_n(count, __ATOMIC_RELAXED) > 0) {
            LOCK;
            const int task = *count > 0 ? ready[--*count] : -1;
            UNLOCK;
            if (task >= 0) return task;
        }
        PAUSE;
    }
"""
)
def take_task(rows: int, columns: int, tasks: wp.array[int]) -> int:  # pyright: ignore
    """Return a task that may begin, when there is one, or -1 when all are done."""


@wp.func_native(
    _LOCK
    + """
    int next = -1;
    LOCK;
    if (task + columns < rows * columns && --waits[task + columns] == 0) next = task + columns;
    if (task % columns < columns - 1 && --waits[task + 1] == 0) {
        if (next < 0) next = task + 1;
        else ready[(*count)++] = task + 1;
    }
    __atomic_store_n(left, *left - 1, __ATOMIC_RELEASE);
    UNLOCK;
    return next;
"""
)
def finish_task(task: int, rows: int, columns: int, tasks: wp.array[int]) -> int:  # pyright: ignore
    """Let begin what waits for `task`; return one of these for the caller to do, or -1."""
