// Shades eyeballs: iris and pupil are drawn from the place on the ball. In: as face.frag, and that place. Out: sRGB.

in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_surface;
in vec2 v_uv;

uniform vec3 u_eye_position;  // camera in world space, mm
uniform vec2 u_iris;  // radius of iris and pupil, as a share of the eyeball's

out vec4 o_colour;

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
    vec2 at = (v_uv - 0.5) * 2.0;
    float radius = length(at);
    vec3 white = v_albedo * mix(vec3(1.0), vec3(0.86, 0.66, 0.62), smoothstep(0.55, 0.95, abs(at.x)));
    vec3 albedo = mix(iris_colour(at, radius), white, smoothstep(u_iris.x - 0.012, u_iris.x + 0.022, radius));
    // The lids' shade lies over the ball.
    float occlusion = mix(1.0, 0.50, smoothstep(0.12, 0.46, at.y)) * mix(1.0, 0.8, smoothstep(-0.25, -0.45, at.y));
    vec3 colour = albedo * irradiance(normal, v_surface.z, occlusion);
    colour += v_surface.x * occlusion * highlight(normal, view, v_surface.y);
    o_colour = tone_map(colour);
}
