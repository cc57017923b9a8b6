// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

/// The label volumes of the examples. All are RAS with the world origin in the middle of the grid.
/// `size` scales the number of voxels along each axis; the spacing stays.
namespace cvmesh::examples {

/// Sizes that the femur has names for.
inline constexpr double kSmall = 0.24, kMedium = 0.5, kFull = 1;
inline constexpr double kMinFemurSize = 0.24, kMaxFemurSize = 2;
inline constexpr double kMinBodySize = 0.25;

/// A femur with a cemented hip prosthesis, 250 x 250 x 500 voxels of 0.5 x 0.4 x 0.8 mm at size 1:
/// 1 prosthesis (stem, neck and head in one), 2 cement mantle, 3 intramedullary canal,
/// 4 trabecular bone, 5 cortical bone, 6 fibrous tissue (patches between cement and bone).
///
/// The neck is resected: there the trabecular bone lies open. Smaller sizes are miniatures, in
/// which cement and cortex keep at least 1 mm so that they stay in one piece.
/// @throws Error BadParameter when `size` is outside [0.24, 2]
InputVolume femur(double size);

/// A trunk from the pelvis to the shoulders, 512 x 512 x 600 voxels of 0.9 x 0.9 x 1 mm at size 1,
/// 60 labels: 1 skin, 2 fat, 3 muscle, 4 what is between the organs, 5 spinal cord, 6 to 22
/// vertebrae from below, 23 to 40 ribs (left and right, from below), 41 sternum, 42 and 43 hip
/// bones, 44 sacrum, 45 oesophagus, 46 trachea, 47 aorta, 48 vena cava, 49 and 50 heart (blood,
/// muscle), 51 gall bladder, 52 and 53 kidneys, 54 pancreas, 55 spleen, 56 liver, 57 stomach, 58
/// bladder, 59 and 60 lungs. For what a whole-body segmentation asks of time and memory, not for
/// anatomy. Smaller sizes are miniatures, in which skin and fat keep at least 1.25 mm.
/// @throws Error BadParameter when `size` is outside [0.25, 1]
InputVolume body(double size);

/// A ball (1) in a shell (2), and a ball (3) pressed to the shell from outside; 1 mm.
InputVolume spheres(double size);

/// A torus (1); 1 mm.
InputVolume torus(double size);

/// A plate (1) of two voxels, tilted so that its faces are lattice planes nowhere; 1 mm. Its
/// thickness does not grow with `size`.
InputVolume plate(double size);

}  // namespace cvmesh::examples
