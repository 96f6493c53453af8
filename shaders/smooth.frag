// Softens the stairs of edges after drawing: finds the edge from the brightness of four diagonal neighbours and
// averages along it. In: place in the picture; the drawn picture. Out: sRGB.

in vec2 v_place;

uniform sampler2D u_picture;

out vec4 o_colour;

float brightness(vec4 colour) {
    return dot(colour.rgb, vec3(0.299, 0.587, 0.114)) + 0.25 * colour.a;
}

void main() {
    ivec2 size = textureSize(u_picture, 0);
    ivec2 at = ivec2(v_place * vec2(size));
    ivec2 last = size - 1;
    vec4 here = texelFetch(u_picture, at, 0);
    float nw = brightness(texelFetch(u_picture, clamp(at + ivec2(-1, 1), ivec2(0), last), 0));
    float ne = brightness(texelFetch(u_picture, clamp(at + ivec2(1, 1), ivec2(0), last), 0));
    float sw = brightness(texelFetch(u_picture, clamp(at + ivec2(-1, -1), ivec2(0), last), 0));
    float se = brightness(texelFetch(u_picture, clamp(at + ivec2(1, -1), ivec2(0), last), 0));
    float centre = brightness(here);
    float low = min(centre, min(min(nw, ne), min(sw, se)));
    float high = max(centre, max(max(nw, ne), max(sw, se)));
    if (high - low < max(0.04, 0.11 * high)) {
        o_colour = here;
        return;
    }
    vec2 along = vec2(-((nw + ne) - (sw + se)), (nw + sw) - (ne + se));
    float shorter = 1.0 / (min(abs(along.x), abs(along.y)) + max(0.03 * (nw + ne + sw + se), 0.008));
    along = clamp(along * shorter, -6.0, 6.0) / vec2(size);
    vec4 narrow = 0.5 * (texture(u_picture, v_place - along / 6.0) + texture(u_picture, v_place + along / 6.0));
    vec4 wide = 0.5 * narrow
        + 0.25 * (texture(u_picture, v_place - along * 0.5) + texture(u_picture, v_place + along * 0.5));
    float wide_brightness = brightness(wide);
    o_colour = wide_brightness < low || wide_brightness > high ? narrow : wide;
}
