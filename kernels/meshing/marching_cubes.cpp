#include "kernels/meshing/marching_cubes.h"

#include <fmt/format.h>

#include <bit>
#include <stdexcept>

#include "kernels/meshing/cube_cases.h"

namespace arah {
namespace {

Launch launch_over(Commands& commands, const MarchingCells& cells, const char* shader, const char* name, const shared::MeshingConstants& constants, const std::vector<uint32_t>& specialization = {}) {
  Launch launch;
  launch.pipeline = &commands.device().pipeline(shader, specialization);
  launch.name = name;
  launch.groups = {marching_blocks(cells.cells), 1, 1};
  launch.push_constants = &constants;
  launch.push_constant_bytes = sizeof constants;
  return launch;
}

}  // namespace

std::vector<uint32_t> marching_case_words() {
  std::vector<uint32_t> words;
  for (const CubeCase& cut : cube_cases()) {
    std::array<uint8_t, 16> bytes{cut.triangles};
    for (size_t i = 0; i < cut.edges.size(); ++i) bytes[i + 1] = cut.edges[i];
    for (size_t i = 0; i < 16; i += 4) words.push_back(bytes[i] | uint32_t{bytes[i + 1]} << 8 | uint32_t{bytes[i + 2]} << 16 | uint32_t{bytes[i + 3]} << 24);
  }
  return words;
}

void record_count_marched(Commands& commands, const MarchingCells& cells) {
  if (cells.cells == 0 || cells.cells > marching_most_cells)
    throw std::invalid_argument(fmt::format("marching cubes over {} cells; 1 to {} are possible", cells.cells, marching_most_cells));
  const shared::MeshingConstants constants{cells.cells};
  const Binding cases{cells.cases, 4096}, marks{cells.marks, cells.cells * 4ull}, blocks{cells.block_counts, marching_blocks(cells.cells) * sizeof(MeshCount)};

  Launch launch = launch_over(commands, cells, "meshing/count_cells", "marching cubes, count", constants);
  launch.bindings = {cases, {cells.node_values, cells.nodes * 16ull}, {cells.corners, cells.cells * 32ull}, marks, blocks};
  launch.cost = {cells.cells * 30.0, cells.cells * (32.0 + 8 * 16 + 4)};
  commands.dispatch(launch);

  launch = launch_over(commands, cells, "meshing/place_cells", "marching cubes, places", constants);
  launch.bindings = {cases, marks, blocks, {cells.places, cells.cells * sizeof(MeshCount)}, {cells.total, sizeof(MeshCount)}};
  launch.cost = {cells.cells * 10.0, cells.cells * 16.0};
  commands.dispatch(launch);
}

void record_march(Commands& commands, const MarchingCells& cells, const MeshCount& total, const BufferSlice& vertices, const BufferSlice& triangles) {
  if (total.vertices == 0 || total.triangles == 0) return;
  const shared::MeshingConstants constants{cells.cells};
  Launch launch = launch_over(commands, cells, "meshing/march_cells", "marching cubes", constants, {std::bit_cast<uint32_t>(static_cast<float>(least_edge_part))});
  launch.groups = {(cells.cells + 63) / 64, 1, 1};
  launch.bindings = {{cells.cases, 4096},
                     {cells.node_values, cells.nodes * 16ull},
                     {cells.corners, cells.cells * 32ull},
                     {cells.cell_of_node, cells.nodes * 4ull},
                     {cells.marks, cells.cells * 4ull},
                     {cells.places, cells.cells * sizeof(MeshCount)},
                     {vertices, total.vertices * 16ull},
                     {triangles, total.triangles * 12ull}};
  launch.cost = {cells.cells * 60.0, cells.cells * (12.0 + 16) + total.vertices * 48.0 + total.triangles * (12 + 3 * 24.0)};
  commands.dispatch(launch);
}

}  // namespace arah
