"""The programs that OpenGL runs at each corner and for each pixel."""

import numpy as np
from numpy.typing import NDArray

VERTEX_SHADER = """#version 330
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec4 rgba;
layout(location = 4) in vec3 gloss;
layout(location = 5) in int geom;
uniform mat4 world_from_body;
uniform mat4 clip_from_world;
uniform mat4 shadow_from_world;
uniform vec3 eye;
// By light: the direction of its rays, ambient, diffuse, specular.
uniform vec3 lights[4 * N_LIGHTS];
invariant gl_Position;
out vec4 own_light;
out vec3 sun_light;
out vec3 in_shadow_map;
out vec2 at;
flat out int id;

vec3 lit(int i, vec3 n, vec3 to_eye) {
    vec3 to_light = -lights[4 * i];
    vec3 sum = rgba.rgb * lights[4 * i + 1];
    float cosine = dot(n, to_light);
    if (cosine > 0.0) {
        float glint = max(dot(n, normalize(to_light + to_eye)), 0.0);
        sum += rgba.rgb * lights[4 * i + 2] * cosine + gloss.x * pow(glint, gloss.y) * lights[4 * i + 3];
    }
    return sum;
}

void main() {
    vec4 place = world_from_body * vec4(position, 1.0);
    vec3 n = normalize(mat3(world_from_body) * normal);
    vec3 to_eye = normalize(eye - place.xyz);
    vec3 sum = gloss.z * rgba.rgb;
    for (int i = 0; i < N_LIGHTS - HAS_SHADOW; i++) sum += lit(i, n, to_eye);
    own_light = vec4(min(sum, 1.0), rgba.a);
#if HAS_SHADOW
    sun_light = min(lit(N_LIGHTS - 1, n, to_eye), 1.0);
    in_shadow_map = (shadow_from_world * place).xyz;
#endif
    at = uv;
    id = geom;
    gl_Position = clip_from_world * place;
}
"""

FRAGMENT_SHADER = """#version 330
in vec4 own_light;
in vec3 sun_light;
in vec3 in_shadow_map;
in vec2 at;
flat in int id;
uniform sampler2D picture;
uniform sampler2DShadow shadow_map;
layout(location = 0) out vec4 colour;
layout(location = 1) out int seen;

#if HAS_SHADOW
float tap(vec2 away) {
    return texture(shadow_map, in_shadow_map + vec3(away / vec2(textureSize(shadow_map, 0)), 0.0));
}

// Share of the sun that gets through: a tap blends four texels. Where those differ, at edges, four more taps
// hide the steps of the map.
float sunny() {
    float middle = tap(vec2(0.0));
    if (middle <= 0.0 || middle >= 1.0) return middle;
    return 0.2 * (middle + tap(vec2(-0.7)) + tap(vec2(0.7)) + tap(vec2(-0.7, 0.7)) + tap(vec2(0.7, -0.7)));
}
#endif

void main() {
    vec3 sum = own_light.rgb;
#if HAS_SHADOW
    if (max(sun_light.r, max(sun_light.g, sun_light.b)) > 0.0) sum += sun_light * sunny();
#endif
#if HAS_TEXTURE
    sum *= texture(picture, at).rgb;
#endif
    colour = vec4(sum, own_light.a);
    seen = id;
}
"""

DEPTH_SHADER = """#version 330
layout(location = 0) in vec3 position;
uniform mat4 world_from_body;
uniform mat4 clip_from_world;
invariant gl_Position;

void main() {
    vec4 place = world_from_body * vec4(position, 1.0);
    gl_Position = clip_from_world * place;
}
"""

NO_COLOUR_SHADER = """#version 330
void main() {}
"""


class Program:
    """A compiled program; values for names that it does not use are left out."""

    def __init__(self, gl: object, words: dict[str, int], vertex: str, fragment: str) -> None:
        self._gl, self._places = gl, {}
        self._name = gl.glCreateProgram()
        sources = ((gl.GL_VERTEX_SHADER, vertex), (gl.GL_FRAGMENT_SHADER, fragment))
        for kind, source in sources:
            for word, value in words.items():
                source = source.replace(word, str(value))
            shader = gl.glCreateShader(kind)
            gl.glShaderSource(shader, source)
            gl.glCompileShader(shader)
            gl.glAttachShader(self._name, shader)
        gl.glLinkProgram(self._name)
        if not gl.glGetProgramiv(self._name, gl.GL_LINK_STATUS):
            raise RuntimeError(f"OpenGL refuses a shader: {gl.glGetProgramInfoLog(self._name)}")

    def use(self) -> None:
        """Makes this the program that draws, and that takes values."""
        self._gl.glUseProgram(self._name)

    def _place(self, name: str) -> int:
        if name not in self._places:
            self._places[name] = self._gl.glGetUniformLocation(self._name, name)
        return self._places[name]

    def set_matrix(self, name: str, matrix: NDArray[np.floating]) -> None:
        """matrix: [4, 4], acting on columns."""
        self._gl.glUniformMatrix4fv(self._place(name), 1, True, matrix.astype(np.float32))

    def set_vectors(self, name: str, vectors: NDArray[np.floating]) -> None:
        """vectors: [3] or [vector, 3]."""
        self._gl.glUniform3fv(self._place(name), vectors.size // 3, vectors.astype(np.float32))

    def set_unit(self, name: str, unit: int) -> None:
        """Names the texture unit that a sampler reads."""
        self._gl.glUniform1i(self._place(name), unit)
