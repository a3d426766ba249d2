#if defined(__x86_64__)
#define PAUSE __builtin_ia32_pause()
#elif defined(__aarch64__)
#define PAUSE __asm__ volatile("yield")
#else
#define PAUSE
#endif

// Tasks of `rows` strips of an image, shared by CPU threads. A strip has only the `columns` blocks
// that may have pixels: it begins `skipped` blocks to the right of the first strip. A task may
// begin when its neighbours on the left and above are done, if there are such. A thread that has
// done a task continues with the one below, and leaves the one on the right, if it may begin, to
// the next thread that asks. So no thread waits while there is work, even if the operating system
// takes a thread off its core.
//
// `shared` holds STATE + 2 rows columns integers: a lock, the number of tasks left, the number of
// tasks that may begin; then a stack of the latter; then, for each task, the number of neighbours
// that it still waits for.
// needs STATE, BLOCK, STRIP, LEAN
struct Tasks {
    int* shared;
    int rows, columns;

    static int skipped(int strip) { return LEAN * STRIP * strip / BLOCK; }
    int* left() const { return shared + 1; }
    int* count() const { return shared + 2; }
    int* ready() const { return shared + STATE; }
    int* waits() const { return ready() + rows * columns; }
    void lock() const {
        while (__atomic_exchange_n(shared, 1, __ATOMIC_ACQUIRE)) PAUSE;
    }
    void unlock() const { __atomic_store_n(shared, 0, __ATOMIC_RELEASE); }

    // Wait for a task that may begin and return it, or -1 when all are done.
    int take() const {
        while (__atomic_load_n(left(), __ATOMIC_ACQUIRE) != 0) {
            if (__atomic_load_n(count(), __ATOMIC_RELAXED) > 0) {
                lock();
                const int task = *count() > 0 ? ready()[--*count()] : -1;
                unlock();
                if (task >= 0) return task;
            }
            PAUSE;
        }
        return -1;
    }

    // Release the tasks that wait for `task`; return the caller's next task, or -1 when all are
    // done.
    int finish(int task) const {
        const int strip = task / columns, column = task % columns;
        const int moved = skipped(strip + 1) - skipped(strip), below = task + columns - moved;
        int next = -1;
        lock();
        if (strip < rows - 1 && column >= moved && --waits()[below] == 0) next = below;
        if (column < columns - 1 && --waits()[task + 1] == 0) {
            if (next < 0)
                next = task + 1;
            else
                ready()[(*count())++] = task + 1;
        }
        __atomic_store_n(left(), *left() - 1, __ATOMIC_RELEASE);
        unlock();
        return next < 0 ? take() : next;
    }
};

#undef PAUSE

// One thread's share of a sweep: the rows of its tasks, row by row.
//
// Pixels (i, j) are counted from the corner where the sweep begins; `step` is 1 for the first
// corner of the image, -1 for the last. A task is STRIP rows of BLOCK diagonals u = j + LEAN i.
// needs BLOCK, STRIP, LEAN
struct Sweep {
    Tasks tasks;
    int height, columns, step;
    int top, kept_rows;  // rows of the image whose sums are kept
    int task, i;
    int begin, end;  // the pixels of row i: j from `begin` to `end`
    int row;         // the row of the sums, -1 if they are not kept

    bool next() {
        if (task == BEGIN) {
            task = tasks.take();
            i = task / tasks.columns * STRIP - 1;
        }
        while (task >= 0) {
            const int strip = task / tasks.columns;
            const int u = (task % tasks.columns + Tasks::skipped(strip)) * BLOCK;
            const int last = (strip + 1) * STRIP < height ? (strip + 1) * STRIP : height;
            for (++i; i < last; ++i) {
                begin = u - LEAN * i > 0 ? u - LEAN * i : 0;
                end = u + BLOCK - LEAN * i < columns ? u + BLOCK - LEAN * i : columns;
                if (begin >= end) continue;
                row = y() - top;
                if (row < 0 || row >= kept_rows) row = -1;
                return true;
            }
            task = tasks.finish(task);
            i = task / tasks.columns * STRIP - 1;
        }
        return false;
    }

    enum { BEGIN = -2 };
    int y() const { return step > 0 ? i : height - 1 - i; }
    int x(int j) const { return step > 0 ? j : columns - 1 - j; }
};

// The step along all paths of a sweep. With q the pixel before p on a path, and m the smallest
// L(q),
//
//     L(p, d) = C(p, d) + min(L(q, d), L(q, d - 1) + P1, L(q, d + 1) + P1, m + P2) - m
//
// (Hirschmueller 2008, equation 13). A chain is a sequence of pixels along a path. A slot holds L
// of the last pixel of a chain, and is updated in place. It has a header, which is a cache line
// with m in its middle, then L for all disparities. A chain begins with a slot of zeros, which
// gives L = C. LARGEST stands on both sides of the disparities and in their padding. It never
// changes, because additions saturate, and it is never chosen.
// A total is the sum of L over the paths, or, with CHANGES, of L - C, which P2 bounds.
// needs NUMBER, VECTOR, HEADER, LARGEST, PATHS, TOTAL, CHANGES
// needs DOWN_THE_ROWS, ALONG_THE_ROW, LAST_WORDS, NEXT_WORDS
struct Steps {
    typedef NUMBER lanes
        __attribute__((vector_size(VECTOR * sizeof(NUMBER)), aligned(sizeof(NUMBER))));
    typedef unsigned long long words __attribute__((vector_size(VECTOR * sizeof(NUMBER))));
    typedef TOTAL sums __attribute__((vector_size(VECTOR * sizeof(TOTAL)), aligned(sizeof(TOTAL))));

    const unsigned char* guide;  // grey values of all pixels, or null
    int p1;
    const unsigned short* p2;
    NUMBER* slots;
    int pitch, padded;

    // The numbers one place before and one place after those of `now`. Words of 64 bits are moved,
    // then bits of two words, which takes less time than moving single numbers.
    enum { BITS = 8 * sizeof(NUMBER), REST = 64 - BITS };
    static lanes lower(words before, words now) {
        return (lanes)(now << BITS | __builtin_shufflevector(before, now, LAST_WORDS) >> REST);
    }
    static lanes upper(words now, words after) {
        return (lanes)(now >> BITS | __builtin_shufflevector(now, after, NEXT_WORDS) << REST);
    }

    // Add the totals of the pixels of a row to their sums of `depth` disparities, or store them.
    static void collect(const Sweep& sweep, const TOTAL* totals, int padded, bool add, TOTAL* sums,
                        int depth) {
        for (int j = sweep.begin; j < sweep.end; ++j, totals += padded) {
            TOTAL* to = sums + ((size_t)sweep.row * sweep.columns + sweep.x(j)) * depth;
            if (add) {
#pragma clang loop vectorize(assume_safety)
                for (int d = 0; d < depth; ++d) to[d] += totals[d];
            } else {
#pragma clang loop vectorize(assume_safety)
                for (int d = 0; d < depth; ++d) to[d] = totals[d];
            }
        }
    }
};

// Compute the totals over the paths, for the pixels of a row, from their costs. ``put(j)`` stores
// the costs of pixel j; the processor does this while it waits for the steps of the pixel before.
const auto advance = [](const Steps& steps, const Sweep& sweep, const NUMBER* costs, TOTAL* totals,
                        const auto& put) __attribute__((always_inline)) {
    typedef Steps::lanes lanes;
    typedef Steps::words words;
    typedef Steps::sums sums;
    const int paths = PATHS, down[] = {DOWN_THE_ROWS}, along[] = {ALONG_THE_ROW};
    const int height = sweep.height, columns = sweep.columns, i = sweep.i;
    const int line = steps.padded, length = steps.pitch, begin = sweep.begin, end = sweep.end;
    const lanes zero = {}, penalty = zero + (NUMBER)steps.p1;
    // For each path: P2 of all pixels, the slot of the next pixel, and m of the one before it.
    NUMBER far[paths][BLOCK];
    NUMBER* slot[paths];
    lanes least[paths];
    size_t chain = 0;
#pragma clang loop unroll(full)
    for (int q = 0; q < paths; ++q) {
        const int most = along[q] * (height - 1), last = down[q] * (columns - 1);
        const int here = down[q] * begin - along[q] * i + (most > 0 ? most : 0);
        slot[q] = steps.slots + (chain + here) * length + HEADER;
        chain += last + (most > 0 ? most : -most) + 1;
        least[q] = zero + slot[q][-HEADER / 2 - 1];
        // Differences of the guide, from left to right in the image. Where a chain begins P2 does
        // not matter, because L of the pixel before is 0.
        const int low = along[q] > begin ? along[q] : begin;
        const int high = columns + along[q] < end ? columns + along[q] : end;
        const int left = sweep.step > 0 ? sweep.x(begin) : sweep.x(end - 1);
        unsigned char apart[BLOCK] = {};
        if (steps.guide && i >= down[q] && low < high) {
            const unsigned char* const p = steps.guide + (size_t)sweep.y() * columns + left;
            const unsigned char* const o =
                p - sweep.step * ((long long)down[q] * columns + along[q]);
            const int from = sweep.step > 0 ? low - begin : end - high;
#pragma clang loop vectorize(assume_safety)
            for (int n = from; n < from + high - low; ++n)
                apart[n] = p[n] < o[n] ? o[n] - p[n] : p[n] - o[n];
        }
        for (int j = begin; j < end; ++j) far[q][j - begin] = steps.p2[apart[sweep.x(j) - left]];
    }
    for (int j = begin; j < end; ++j, costs += line, totals += line) {
        put(j);
        lanes before[paths], now[paths], jump[paths], minimum[paths];
#pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) {
            if (down[q]) least[q] = zero + slot[q][-HEADER / 2 - 1];
            jump[q] = least[q] + far[q][j - begin];
            before[q] = zero + (NUMBER)LARGEST;
            now[q] = *(const lanes*)slot[q];
            minimum[q] = zero + (NUMBER)LARGEST;
        }
        for (int d = 0; d < line; d += VECTOR) {
            const lanes c = *(const lanes*)(costs + d);
            sums sum = {};
#pragma clang loop unroll(full)
            for (int q = 0; q < paths; ++q) {
                const lanes after = *(const lanes*)(slot[q] + d + VECTOR);
                const lanes beside = __builtin_elementwise_add_sat(
                    __builtin_elementwise_min(Steps::lower((words)before[q], (words)now[q]),
                                              Steps::upper((words)now[q], (words)after)),
                    penalty);
                const lanes near = __builtin_elementwise_min(now[q], beside);
                const lanes change = __builtin_elementwise_min(near, jump[q]) - least[q];
                const lanes l = __builtin_elementwise_add_sat(change, c);
                *(lanes*)(slot[q] + d) = l;
                minimum[q] = __builtin_elementwise_min(minimum[q], l);
                sum += __builtin_convertvector(CHANGES ? change : l, sums);
                before[q] = now[q];
                now[q] = after;
            }
            *(sums*)(totals + d) = sum;
        }
#pragma clang loop unroll(full)
        for (int q = 0; q < paths; ++q) {
            const NUMBER m = __builtin_reduce_min(minimum[q]);
            least[q] = zero + m;
            slot[q][-HEADER / 2 - 1] = m;
            slot[q] += down[q] * length;
        }
    }
};
