#include "host/evaluation/marched_mesh.h"

#include "host/input_error.h"
#include "kernels/meshing/marching_cubes.h"

namespace arah {

TriangleMesh marched_mesh(Device& device, Commands& commands, const SurfaceCells& cells) {
  TriangleMesh mesh;
  if (cells.corners.empty()) return mesh;
  if (cells.corners.size() > marching_most_cells)
    throw InputError("--cell", "", fmt::format("cubes large enough that the surface crosses at most {} of them", marching_most_cells), fmt::format("{} of {} mm", cells.corners.size(), 1000 * cells.cell));
  const auto filled = [&](const char* name, const auto& values) {
    Buffer buffer(device, name, values.size() * sizeof values[0], BufferPlace::device);
    device.upload(buffer.slice(), values);
    return buffer;
  };
  const auto count = static_cast<uint32_t>(cells.corners.size());
  Buffer nodes = filled("marching cubes: nodes", cells.nodes), corners = filled("marching cubes: corners", cells.corners), owners = filled("marching cubes: cells of nodes", cells.cell_of_node()),
         cases = filled("marching cubes: cases", marching_case_words());
  Buffer marks(device, "marching cubes: marks", count * 4ull, BufferPlace::device), blocks(device, "marching cubes: counts of blocks", marching_blocks(count) * sizeof(MeshCount), BufferPlace::device),
      places(device, "marching cubes: places", count * sizeof(MeshCount), BufferPlace::device), total(device, "marching cubes: total", sizeof(MeshCount), BufferPlace::shared);
  const MarchingCells marching{count, static_cast<uint32_t>(cells.nodes.size()), nodes.slice(), corners.slice(), owners.slice(), cases.slice(), marks.slice(), blocks.slice(), places.slice(), total.slice()};
  record_count_marched(commands, marching);
  commands.submit_and_wait();
  const MeshCount counted = device.download<MeshCount>(total.slice())[0];
  if (counted.vertices == 0 || counted.triangles == 0) return mesh;

  Buffer vertices(device, "marching cubes: vertices", counted.vertices * 16ull, BufferPlace::device), triangles(device, "marching cubes: triangles", counted.triangles * 12ull, BufferPlace::device);
  record_march(commands, marching, counted, vertices.slice(), triangles.slice());
  commands.submit_and_wait();
  for (const auto& v : device.download<std::array<float, 4>>(vertices.slice().sub(0, counted.vertices * 16ull))) mesh.vertices.emplace_back(v[0], v[1], v[2]);
  for (const auto& t : device.download<std::array<uint32_t, 3>>(triangles.slice().sub(0, counted.triangles * 12ull))) {
    for (const uint32_t v : t)
      if (v >= counted.vertices) throw std::logic_error("marching cubes: a cube that the surface crosses is missing");
    mesh.triangles.emplace_back(t[0], t[1], t[2]);
  }
  return mesh;
}

}  // namespace arah
