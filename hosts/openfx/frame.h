// SPDX-License-Identifier: Apache-2.0
// Pixels between a host and the resident process: both ways by rows, the top row first, whatever the host's layout is.
#pragma once

#include "../openimageio/resident.h"
#include "host.h"

namespace oiiotex {

// The facts of an image, as in service/pictures.py: pixels `bounds` of an image whose region is `whole`.
Json image_facts(const std::string& slot, const ofx::RectI& bounds, const ofx::RectI& whole, int channels,
                 const std::string& type, const std::string& space);

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

// Copy the pixels of an answer, whose corner at the lower left is at (x, y), into the window of an image; 0 elsewhere.
void copy_answer(const Reply& reply, int x, int y, const HostImage& out, const ofx::RectI& window);

// Copy an image into the window of another one of the same channels and type; 0 elsewhere.
void copy_image(const HostImage& from, const HostImage& out, const ofx::RectI& window);

}  // namespace oiiotex
