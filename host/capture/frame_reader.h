// Photographs and masks of a dataset's frames, whichever way they lie on disk. For .cpp files only.
#pragma once

#include <map>
#include <memory>

#include "host/capture/dataset.h"
#include "host/capture/hdf5_file.h"
#include "host/capture/imported_picture.h"
#include "host/capture/video_frames.h"

namespace arah {

class FrameReader {
 public:
  // Pixels of what is a frame of a video or of HDF5's masks; picture files are left to import_picture(). One call at a time, best in
  // the frames' order. Throws InputError as VideoFrames and Hdf5File do.
  SourcePicture read(const DatasetPicture& picture);

 private:
  struct Masks {
    std::unique_ptr<Hdf5File> file;
    Hdf5File::Frames frames;
  };
  std::map<std::filesystem::path, std::unique_ptr<VideoFrames>> videos_;
  std::map<std::filesystem::path, Masks> masks_;
};

}  // namespace arah
