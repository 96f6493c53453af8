// Shades skin, hair, teeth and eyes. In: world position (mm), normal, linear albedo. Out: sRGB, premultiplied alpha 1.

in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec4 v_surface;
in vec2 v_uv;
in float v_occlusion;

uniform vec3 u_eye_position;  // camera in world space, mm
uniform vec2 u_iris;  // radius of iris and pupil, as a share of the eyeball's

out vec4 o_colour;

const vec3 KEY_FROM = vec3(-0.42, 0.52, 0.745);
const vec3 KEY_COLOUR = vec3(1.85, 1.72, 1.57);
const vec3 FILL_FROM = vec3(0.80, 0.10, 0.59);
const vec3 FILL_COLOUR = vec3(0.42, 0.47, 0.56);
const vec3 RIM_FROM = vec3(0.62, 0.40, -0.68);
const vec3 RIM_COLOUR = vec3(0.85, 0.90, 1.0);
const vec3 SKY = vec3(0.46, 0.49, 0.55);
const vec3 GROUND = vec3(0.30, 0.25, 0.22);

float wrapped(float cosine, float softness) {
    float light = clamp((cosine + softness) / (1.0 + softness), 0.0, 1.0);
    return light * light * (1.0 + softness) * 0.5 + light * (1.0 - softness) * 0.5;
}

vec3 iris_colour(vec2 at, float radius) {
    float share = radius / u_iris.x;
    float around = atan(at.y, at.x);
    float fibres = 0.5 + 0.5 * sin(around * 37.0 + 3.0 * sin(around * 11.0)) * sin(around * 23.0 + share * 9.0);
    vec3 outer = vec3(0.115, 0.060, 0.026);
    vec3 inner = vec3(0.300, 0.165, 0.070);
    vec3 colour = mix(inner, outer, smoothstep(0.35, 0.95, share)) * (0.75 + 0.5 * fibres);
    colour *= 1.0 + 0.7 * smoothstep(0.2, -0.9, at.y / u_iris.x);  // light gathers opposite the key
    colour *= 1.0 - 0.75 * smoothstep(0.80, 1.0, share);
    return mix(vec3(0.004), colour, smoothstep(u_iris.y - 0.02, u_iris.y + 0.02, radius));
}

void main() {
    vec3 normal = normalize(v_normal);
    vec3 view = normalize(u_eye_position - v_position);
    vec3 albedo = v_albedo;
    float softness = v_surface.z;
    float occlusion = v_occlusion;
    if (v_surface.w > 0.5) {
        vec2 at = (v_uv - 0.5) * 2.0;
        float radius = length(at);
        vec3 white = albedo * mix(vec3(1.0), vec3(0.86, 0.66, 0.62), smoothstep(0.55, 0.95, abs(at.x)));
        albedo = mix(iris_colour(at, radius), white, smoothstep(u_iris.x - 0.012, u_iris.x + 0.022, radius));
        occlusion = mix(1.0, 0.50, smoothstep(0.12, 0.46, at.y)) * mix(1.0, 0.8, smoothstep(-0.25, -0.45, at.y));
    }
    float key = dot(normal, KEY_FROM);
    vec3 terminator = mix(vec3(1.0), vec3(1.25, 0.72, 0.60), softness * smoothstep(0.45, -0.1, key));
    vec3 light = KEY_COLOUR * wrapped(key, softness) * terminator * mix(0.35, 1.0, smoothstep(0.05, 0.6, occlusion));
    light += FILL_COLOUR * wrapped(dot(normal, FILL_FROM), softness) * mix(0.5, 1.0, occlusion);
    light += mix(GROUND, SKY, 0.5 + 0.5 * normal.y) * occlusion;
    vec3 colour = albedo * light;

    float facing = clamp(dot(normal, view), 0.0, 1.0);
    float fresnel = 0.04 + 0.55 * pow(1.0 - facing, 5.0);
    float gloss = v_surface.y;
    float lobe = (gloss + 8.0) / 25.0;
    float high = pow(clamp(dot(normal, normalize(KEY_FROM + view)), 0.0, 1.0), gloss) * clamp(key * 4.0, 0.0, 1.0);
    high += 0.25 * pow(clamp(dot(normal, normalize(FILL_FROM + view)), 0.0, 1.0), gloss);
    colour += v_surface.x * (0.25 + fresnel) * lobe * high * KEY_COLOUR * occlusion;
    float rim = pow(1.0 - facing, 3.0) * clamp(dot(normal, RIM_FROM) + 0.3, 0.0, 1.0);
    colour += RIM_COLOUR * rim * (0.10 + 0.5 * v_surface.x) * occlusion * (albedo + 0.15);

    colour = colour * (1.0 + colour * 0.12) / (1.0 + colour * 0.42);  // shoulder, keeps highlights
    o_colour = vec4(pow(max(colour, 0.0), vec3(1.0 / 2.2)), 1.0);
}
