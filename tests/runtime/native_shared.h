#pragma once

struct Ends {
    static int within(int i, int n) { return i < 0 ? 0 : i < n ? i : n - 1; }
};
