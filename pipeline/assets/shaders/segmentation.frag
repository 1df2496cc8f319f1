#version 330 core
// A part's number, the same in every channel.
uniform vec3 color;
out vec4 shown;

void main()
{
    shown = vec4(color, 1.0);
}
