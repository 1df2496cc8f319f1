#version 330 core
// A vertex into the image; where it is in the world and its normal go on to the fragment shader. Poses are rigid.
layout(location = 0) in vec3 position;
layout(location = NORMAL_LOC) in vec3 normal;
#ifdef TEXCOORD_0_LOC
layout(location = TEXCOORD_0_LOC) in vec2 texcoord;
out vec2 at_uv;
#endif
#ifdef COLOR_0_LOC
layout(location = COLOR_0_LOC) in vec4 vertex_color;
out vec3 at_color;
#endif

uniform mat4 M;  // part to world
uniform mat4 V;  // world to camera
uniform mat4 P;  // camera to image

out vec3 at;
out vec3 turned;

void main()
{
    vec4 world = M * vec4(position, 1.0);
    gl_Position = P * (V * world);
    at = world.xyz;
    turned = mat3(M) * normal;
#ifdef TEXCOORD_0_LOC
    at_uv = texcoord;
#endif
#ifdef COLOR_0_LOC
    at_color = vertex_color.rgb;
#endif
}
