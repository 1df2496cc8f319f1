#version 330 core
// One lamp that falls off with the square of the distance and constant light, on a matt surface with a faint Blinn-Phong highlight
// (dielectrics reflect about 4 %). Both sides of a face are lit alike.
const float GLOSS = 0.06;
const float SHARPNESS = 20.0;

struct Material { vec4 base_color_factor; sampler2D base_color_texture; };
struct Lamp { vec3 position; vec3 color; float intensity; };

uniform Material material;
uniform Lamp point_lights[1];
uniform vec3 ambient_light;
uniform vec3 cam_pos;

in vec3 at;
in vec3 turned;
#ifdef TEXCOORD_0_LOC
in vec2 at_uv;
#endif
#ifdef COLOR_0_LOC
in vec3 at_color;  // sRGB, interpolated as it is stored
#endif
out vec4 shown;

vec3 to_linear(vec3 srgb)
{
    return mix(pow((srgb + 0.055) / 1.055, vec3(2.4)), srgb / 12.92, lessThanEqual(srgb, vec3(0.04045)));
}

vec3 to_srgb(vec3 light)
{
    return mix(1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, light * 12.92, lessThanEqual(light, vec3(0.0031308)));
}

void main()
{
    vec3 albedo = material.base_color_factor.rgb;
#ifdef TEXCOORD_0_LOC
    albedo *= to_linear(texture(material.base_color_texture, at_uv).rgb);
#endif
#ifdef COLOR_0_LOC
    albedo *= to_linear(at_color);
#endif

    // The face's own normal, on the camera's side; the smooth normal goes where it goes, whatever way the face is wound.
    vec3 to_eye = cam_pos - at;
    vec3 facing = cross(dFdx(at), dFdy(at));
    facing *= sign(dot(facing, to_eye));
    vec3 n = normalize(turned);
    n *= dot(n, facing) < 0.0 ? -1.0 : 1.0;

    vec3 to_lamp = point_lights[0].position - at;
    float squared = dot(to_lamp, to_lamp);
    bool apart = squared > 0.0;  // else the lamp stands here, and its light has no direction
    vec3 light = apart ? point_lights[0].color * point_lights[0].intensity / squared : vec3(0.0);
    vec3 l = apart ? normalize(to_lamp) : n;
    float diffuse = max(dot(n, l), 0.0);
    float highlight = diffuse > 0.0 ? pow(max(dot(n, normalize(l + normalize(to_eye))), 0.0), SHARPNESS) : 0.0;
    vec3 color = albedo * (ambient_light + light * diffuse) + light * GLOSS * highlight;
    shown = vec4(to_srgb(clamp(color, 0.0, 1.0)), 1.0);
}
