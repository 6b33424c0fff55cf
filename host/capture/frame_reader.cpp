#include "host/capture/frame_reader.h"

#include <fmt/format.h>

#include "host/capture/picture_file.h"

namespace arah {

SourcePicture FrameReader::read(const DatasetPicture& picture) {
  SourcePicture source{{}, {}, picture.image.string(), picture.mask.string()};
  if (picture.image_frame >= 0) {
    std::unique_ptr<VideoFrames>& video = videos_[picture.image];
    if (!video) video = std::make_unique<VideoFrames>(picture.image);
    source.image = video->read(static_cast<std::size_t>(picture.image_frame));
    source.image_name += fmt::format(" frame {}", picture.image_frame);
  }
  if (picture.mask_frame >= 0) {
    Masks& masks = masks_[picture.mask];
    if (!masks.file) {
      masks.file = std::make_unique<Hdf5File>(picture.mask);
      masks.frames = masks.file->open_frames("masks", kLargestPicture);
    }
    source.mask = cv::Mat(masks.frames.height, masks.frames.width, CV_8U);
    masks.file->frame(static_cast<std::size_t>(picture.mask_frame), {source.mask.data, source.mask.total()});
    source.mask_name += fmt::format(" frame {}", picture.mask_frame);
  }
  return source;
}

}  // namespace arah
