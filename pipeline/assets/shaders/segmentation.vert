#version 330 core
// The image position by the same sum as in mesh.vert, so that both images agree.
layout(location = 0) in vec3 position;

uniform mat4 M;
uniform mat4 V;
uniform mat4 P;

void main()
{
    gl_Position = P * (V * (M * vec4(position, 1.0)));
}
