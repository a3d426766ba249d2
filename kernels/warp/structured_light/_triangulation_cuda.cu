#include "_triangulation.h"

// needs NEWTON_STEPS, WIDEST, LENS_STEPS, NEAR, STOPS, STILL, AXIS
// The point of a pixel.
void intersect_pixel(wp::array_t<float> places, wp::array_t<wp::uint8> valid,
                     wp::array_t<float> lenses, wp::array_t<float> pose,
                     wp::array_t<float> points) {
    const int width = places.shape[1];
    const unsigned item = blockIdx.x * blockDim.x + threadIdx.x;
    if (item >= (unsigned)(places.shape[0] * width)) return;
    const int i = (int)(item / width), j = (int)(item - i * width);
    const bool all = valid.shape[0] != places.shape[0] || valid.shape[1] != width;
    const float place = places.data[item];
    float x, y, depth = 0.0f;
    Light::straighten(lenses.data, (float)i, (float)j, x, y);
    if (place >= -0.5f && (all || valid.data[item] != 0))
        depth = Light::meet(lenses.data + 9, pose.data, AXIS, place, x, y);
    depth = depth > 0.0f ? depth : __int_as_float(0x7fc00000);
    float* point = points.data + 3 * (size_t)item;
    point[0] = depth * x, point[1] = depth * y, point[2] = depth;
}
