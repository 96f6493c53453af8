// Shades skin, lips, hair, teeth, cloth. In: world position (mm), normal, linear albedo. Out: sRGB, alpha 1.

in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_surface;
in float v_occlusion;

uniform vec3 u_eye_position;  // camera in world space, mm

out vec4 o_colour;

void main() {
    vec3 normal = normalize(v_normal);
    vec3 view = normalize(u_eye_position - v_position);
    float strength = v_surface.x;
    vec3 colour = v_albedo * lit(normal, v_surface.z, v_occlusion);
    colour += strength * v_occlusion * highlight(normal, view, v_surface.y);
    float away = 1.0 - clamp(dot(normal, view), 0.0, 1.0);
    float rim = away * away * away * clamp(dot(normal, RIM_FROM) + 0.3, 0.0, 1.0);
    colour += RIM_COLOUR * rim * (0.10 + 0.5 * strength) * v_occlusion * (v_albedo + 0.15);
    o_colour = developed(colour);
}
