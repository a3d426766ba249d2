// The codes of four neighbouring pixels, from pixel `first` on, and whether they are known. With
// `joins`, a pixel that was not valid stays so. All are written at once where they are aligned.
struct Codes {
    static void store(const int* found, size_t first, size_t plane, bool joins, int* codes,
                      wp::uint8* valid) {
        if (plane % 4 == 0 && (size_t)codes % 16 == 0 && (size_t)valid % 4 == 0) {
            if (first >= plane) return;
            *(int4*)(codes + first) = make_int4(found[0], found[1], found[2], found[3]);
            uchar4* good = (uchar4*)(valid + first);
            const uchar4 before = joins ? *good : make_uchar4(1, 1, 1, 1);
            *good = make_uchar4(before.x && found[0] >= 0, before.y && found[1] >= 0,
                                before.z && found[2] >= 0, before.w && found[3] >= 0);
            return;
        }
        for (int i = 0; i < 4 && first + i < plane; ++i) {
            codes[first + i] = found[i];
            valid[first + i] = (!joins || valid[first + i]) && found[i] >= 0;
        }
    }
};
