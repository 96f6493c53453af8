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
uniform sampler2D u_skin;  // sRGB; alpha is the light of folds, or where CUT_OUT below one half a hole
in float v_fold;  // share of the folds

const float FOLDS = 0.9;  // change of the light at the ends of alpha, by full folds
const float PORES = 0.25;  // pores stay within this of alpha's middle, folds beyond it
const float BREAK_UP = 2.0;  // change of the highlights by pores
const float SKIN = 28.0;  // skin has a share of folds of 0.035 where it has no lines

// Diffuse and specular light, linear RGB, as the painting tints it. A square stands in for the power of 2.2, as in
// tone_map().
vec3 painted(vec3 diffuse, vec3 specular, vec2 at) {
    vec4 paint = texture(u_skin, at);
#ifdef CUT_OUT
    if (paint.a < 0.5) discard;
    return paint.rgb * paint.rgb * diffuse + specular;
#else
    float relief = 2.0 * paint.a - 1.0;
    float pores = clamp(relief, -PORES, PORES);
    return paint.rgb * paint.rgb * diffuse * (1.0 + FOLDS * v_fold * (relief - pores))
        + specular * (1.0 + BREAK_UP * min(SKIN * v_fold, 1.0) * pores);
#endif
}
#else
#define painted(diffuse, specular, at) (diffuse + specular)
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
    o_colour = tone_map(painted(v_diffuse.rgb, v_specular.rgb, uv));
#else
    vec2 uv = v_uv;
    Light light = shade(v_position, v_normal, u_eye_position, v_albedo, v_surface, v_occlusion);
    o_colour = tone_map(painted(light.diffuse, light.specular, uv));
#endif
#ifdef STRAND
    o_colour.a = coverage(uv);
#endif
}
