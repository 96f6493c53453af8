// Converts an image to I420, one byte per pixel: the rows of its luma; below them, with CHROMA, Cb and Cr at half its
// width and height, row after row. Rec. 601 of limited range, in the whole numbers of native/src/face.c. In: the image.
// Out: a byte as 0 to 1.

uniform sampler2D u_picture;

out vec4 o_value;

vec3 levels(ivec2 at) {
    return floor(texelFetch(u_picture, at, 0).rgb * 255.0 + 0.5);
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
#ifdef CHROMA
    ivec2 size = textureSize(u_picture, 0), half_size = size / 2;
    int place = (at.y - size.y) * size.x + at.x, count = half_size.x * half_size.y;
    vec3 weights = place < count ? vec3(-38, -74, 112) : vec3(112, -94, -18);
    place -= place < count ? 0 : count;
    int row = place / half_size.x;
    ivec2 corner = 2 * ivec2(place - row * half_size.x, row);
    vec3 four = levels(corner) + levels(corner + ivec2(1, 0)) + levels(corner + ivec2(0, 1)) + levels(corner + 1);
    float value = (dot(weights, four) + 131584.0) / 1024.0;
#else
    float value = (dot(vec3(66, 129, 25), levels(at)) + 4224.0) / 256.0;
#endif
    o_value = vec4(floor(value) / 255.0);
}
