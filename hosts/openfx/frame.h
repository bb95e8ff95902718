// SPDX-License-Identifier: Apache-2.0
// Pixels between a host and the resident process: both ways by rows, the top row first, whatever the host's layout is.
#pragma once

#include "../openimageio/resident.h"
#include "host.h"

#include <memory>

namespace oiiotex {

// The facts of an image, as in service/pictures.py: pixels `bounds` of an image whose region is `whole`.
Json image_facts(const std::string& slot, const ofx::RectI& bounds, const ofx::RectI& whole, int channels,
                 const std::string& type, const std::string& space, bool unpremultiplied);

// An image of a clip as the process gets it.
struct Input {
    std::string slot;  // of the op
    HostImage image;
    bool mask;  // one channel is sent: alpha, or the first of RGB

    Json facts(const std::string& space) const;
    void add_to(uint64_t hash[2]) const;
    Sent sent() const;
};

// The hexadecimal hash of a request and of the pixels of its images.
std::string key_of(const Json& request, const std::vector<Input>& inputs);

// A finished frame: the facts of the answer, and its pixels in memory that no process can change or shorten.
class Frame {
public:
    explicit Frame(const Reply& reply);
    Json facts;

    // Copy it into the window of an image of its channels and type, its lower left corner to (x, y); 0 elsewhere.
    void copy(int x, int y, const HostImage& out, const ofx::RectI& window) const;

private:
    size_t m_bytes = 0;
    std::shared_ptr<const char> m_pixels;
};

// The frames that were used last, so that a viewer that pans need not even ask the process.
class RecentFrames {
public:
    std::shared_ptr<const Frame> find(const std::string& key);  // or nullptr
    std::shared_ptr<const Frame> keep(const std::string& key, std::shared_ptr<const Frame> frame);

private:
    std::mutex m_lock;
    std::vector<std::pair<std::string, std::shared_ptr<const Frame>>> m_frames;  // the last used is the last
};

// Copy an image into the window of another one of the same channels and type; 0 elsewhere.
void copy_image(const HostImage& from, const HostImage& out, const ofx::RectI& window);

}  // namespace oiiotex
