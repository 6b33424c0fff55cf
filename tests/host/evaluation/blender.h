// What Blender makes of a GLB file, where it is installed.
#pragma once

#include <optional>

#include "tests/host/body/glb_reader.h"

namespace arah {

struct BlenderMesh {
  std::vector<glm::vec3> vertices;  // Blender's world: z up
  std::vector<glm::uvec3> triangles;
};

// The meshes after import at whole frames, 24 a second, from 0 on; none where there is no `blender` on the PATH, or no NumPy, which its
// glTF add-on needs. Throws
// std::runtime_error with Blender's words where it fails.
inline std::optional<std::vector<BlenderMesh>> blender_meshes(const std::filesystem::path& glb, int frames, const std::filesystem::path& folder) {
  if (!output_of("command -v blender && python3 -c 'import numpy'")) return {};
  std::ofstream(folder / "import.py") << R"(
import bpy, struct, sys, numpy
if not hasattr(numpy, 'bool'): numpy.bool = bool  # the add-on of Debian's Blender 3.4 meets a NumPy that has dropped the name
glb, out, frames = sys.argv[-3], sys.argv[-2], int(sys.argv[-1])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 24
bpy.ops.import_scene.gltf(filepath=glb)
mesh = [o for o in bpy.context.scene.objects if o.type == 'MESH' and o.vertex_groups][0]
for frame in range(frames):
    bpy.context.scene.frame_set(frame)
    o = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    m = o.to_mesh()
    m.calc_loop_triangles()
    with open('%s/%d.bin' % (out, frame), 'wb') as f:
        f.write(struct.pack('<II', len(m.vertices), len(m.loop_triangles)))
        for v in m.vertices: f.write(struct.pack('<3f', *(o.matrix_world @ v.co)))
        for t in m.loop_triangles: f.write(struct.pack('<3I', *t.vertices))
    o.to_mesh_clear()
)";
  const std::optional<std::string> said = output_of(fmt::format("blender -b --python-exit-code 3 --python '{}' -- '{}' '{}' {}", (folder / "import.py").string(), glb.string(), folder.string(), frames));
  if (!said) throw std::runtime_error("Blender could not import " + glb.string());
  std::vector<BlenderMesh> meshes;
  for (int frame = 0; frame < frames; ++frame) {
    std::ifstream file(folder / fmt::format("{}.bin", frame), std::ios::binary);
    std::uint32_t counts[2] = {0, 0};
    file.read(reinterpret_cast<char*>(counts), sizeof counts);
    BlenderMesh mesh{std::vector<glm::vec3>(counts[0]), std::vector<glm::uvec3>(counts[1])};
    file.read(reinterpret_cast<char*>(mesh.vertices.data()), static_cast<std::streamsize>(12ull * counts[0]));
    file.read(reinterpret_cast<char*>(mesh.triangles.data()), static_cast<std::streamsize>(12ull * counts[1]));
    if (!file) throw std::runtime_error("Blender wrote no mesh: " + *said);
    meshes.push_back(std::move(mesh));
  }
  return meshes;
}

}  // namespace arah
