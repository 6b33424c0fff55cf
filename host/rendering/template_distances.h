// How far places are from the template's vertices: the rough bound on where anything can be.
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "host/body/body_template.h"
#include "shaders/shared/shell_grid.h"

namespace arah {

// A grid of at most `most_nodes` nodes over the vertices' box grown by `margin`, metres; its cells are `cell` metres or, where
// that would be too many nodes, larger.
shared::ShellGrid grid_around(const std::vector<glm::dvec3>& vertices, double margin, double cell, double most_nodes);

// By node, padded: signed distance to the nearest vertex, metres, negative where the node lies behind the vertex' normal;
// +reach at nodes that no vertex is nearer to, whichever side they are on.
std::vector<float> template_distances(const shared::ShellGrid& grid, const std::vector<glm::dvec3>& vertices, const std::vector<glm::uvec3>& triangles, double reach);

}  // namespace arah
