#pragma once

// Operations of a warp on the tensor cores. Pointers refer to registers, each of which holds two
// float16 numbers.
struct TensorCores {
    // c += a b for 16 samples x 16 and 16 x 8.
    static void mma(float* c, const unsigned int* a, unsigned int b0, unsigned int b1) {
        asm volatile(
            "mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 "
            "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
            : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
            : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
    }

    // Load four 8 x 8 pieces; lane 8 i + j gives the address of row j of piece i.
    static void load(unsigned int* p, const unsigned short* row) {
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0, %1, %2, %3}, [%4];"
                     : "=r"(p[0]), "=r"(p[1]), "=r"(p[2]), "=r"(p[3])
                     : "r"((unsigned int)__cvta_generic_to_shared(row))
                     : "memory");
    }

    static void load_turned(unsigned int* p, const unsigned short* row) {
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0, %1, %2, %3}, [%4];"
                     : "=r"(p[0]), "=r"(p[1]), "=r"(p[2]), "=r"(p[3])
                     : "r"((unsigned int)__cvta_generic_to_shared(row))
                     : "memory");
    }

    static unsigned int turn(unsigned int piece) {
        unsigned int turned;
        asm volatile("movmatrix.sync.aligned.m8n8.trans.b16 %0, %1;" : "=r"(turned) : "r"(piece));
        return turned;
    }

    // Round two numbers to float16, clamped to its range.
    static unsigned int pack(float low, float high) {
        unsigned int both;
        asm("cvt.rn.satfinite.f16x2.f32 %0, %1, %2;" : "=r"(both) : "f"(high), "f"(low));
        return both;
    }

    // Read four columns of a row of a matrix with `rows` rows; further rows are zeros.
    static uint2 four(const unsigned short* from, int row, int rows, int pitch) {
        return row < rows ? *(const uint2*)(from + (size_t)row * pitch) : make_uint2(0u, 0u);
    }
};
