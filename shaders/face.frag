// Shades skin, lips, hair, teeth, cloth. In: world position (mm), normal, linear albedo; with LIT_AT_VERTICES the light,
// ready but for the painting. PAINTED: a picture tints the surface; CUT_OUT: and has holes; STRAND: single hairs on
// ribbons wider than themselves. Out: sRGB; alpha is 1, or the share of the pixel that a hair covers.

#ifdef LIT_AT_VERTICES
in vec4 v_diffuse;
in vec4 v_specular;
#else
in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_surface;
in vec2 v_uv;
in float v_occlusion;

uniform vec3 u_eye_position;  // camera in world space, mm
#endif

#ifdef PAINTED
uniform sampler2D u_skin;  // sRGB; alpha below one half is a hole

// Linear RGB. A square stands in for the power of 2.2, as in tone_map().
vec3 painting(vec2 at) {
    vec4 paint = texture(u_skin, at);
#ifdef CUT_OUT
    if (paint.a < 0.5) discard;
#endif
    return paint.rgb * paint.rgb;
}
#else
const vec3 NO_PAINT = vec3(1.0);
#define painting(at) NO_PAINT
#endif

out vec4 o_colour;

#ifdef STRAND
// Share of a pixel that a hair covers. across: place across the hair, and its half width, mm.
float coverage(vec2 across) {
    float pixel = max(length(vec2(dFdx(across.x), dFdy(across.x))), 1e-4);  // mm
    float overlap = min(across.x + 0.5 * pixel, across.y) - max(across.x - 0.5 * pixel, -across.y);
    return clamp(overlap / pixel, 0.0, 1.0);
}
#endif

void main() {
#ifdef LIT_AT_VERTICES
    vec2 uv = vec2(v_diffuse.a, v_specular.a);
    o_colour = tone_map(painting(uv) * v_diffuse.rgb + v_specular.rgb);
#else
    vec2 uv = v_uv;
    Light light = shade(v_position, v_normal, u_eye_position, v_albedo, v_surface, v_occlusion);
    o_colour = tone_map(painting(uv) * light.diffuse + light.specular);
#endif
#ifdef STRAND
    o_colour.a = coverage(uv);
#endif
}
