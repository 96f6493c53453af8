// Brightness of a pixel and of its four diagonal neighbours; joined in front of edges.frag and smooth.frag.

in vec2 v_place;

uniform sampler2D u_picture;

float brightness(vec4 colour) {
    return dot(colour.rgb, vec3(0.299, 0.587, 0.114)) + 0.25 * colour.a;
}

float brightness_at(ivec2 at) {
    return brightness(texelFetch(u_picture, clamp(at, ivec2(0), textureSize(u_picture, 0) - 1), 0));
}

// In the order -x +y, +x +y, -x -y, +x -y.
vec4 diagonals(ivec2 at) {
    return vec4(
        brightness_at(at + ivec2(-1, 1)), brightness_at(at + ivec2(1, 1)),
        brightness_at(at + ivec2(-1, -1)), brightness_at(at + ivec2(1, -1)));
}

// The darkest and the brightest of the five.
vec2 extremes(float centre, vec4 around) {
    vec2 low = min(around.xy, around.zw);
    vec2 high = max(around.xy, around.zw);
    return vec2(min(centre, min(low.x, low.y)), max(centre, max(high.x, high.y)));
}
