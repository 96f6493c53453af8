// Shades skin, lips, hair, teeth, cloth. In: world position (mm), normal, linear albedo; with LIT_AT_VERTICES the light,
// ready but for the painting. PAINTED: a picture tints the surface; CUT_OUT: and has holes. Out: sRGB, alpha 1.

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

void main() {
#ifdef LIT_AT_VERTICES
    o_colour = tone_map(painting(vec2(v_diffuse.a, v_specular.a)) * v_diffuse.rgb + v_specular.rgb);
#else
    Light light = shade(v_position, v_normal, u_eye_position, v_albedo, v_surface, v_occlusion);
    o_colour = tone_map(painting(v_uv) * light.diffuse + light.specular);
#endif
}
