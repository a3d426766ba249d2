#pragma once

// The touched nodes from `begin` to `end`; marks are read eight at a time.
struct TouchedNodes {
    const wp::uint8* touched;
    size_t begin, end, node;

    TouchedNodes(const wp::uint8* touched, size_t begin, size_t end)
        : touched(touched), begin(begin), end(end), node(begin - 1) {}

    // Move to the next touched node, if there is one.
    bool next() {
        for (++node; node < end; ++node) {
            if (((node - begin) & 7) == 0)
                while (node + 8 <= end) {
                    unsigned long long any = 0;
                    __builtin_memcpy(&any, touched + node, 8);
                    if (any) break;
                    node += 8;
                }
            if (node < end && touched[node]) return true;
        }
        return false;
    }
};
