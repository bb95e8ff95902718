// SPDX-License-Identifier: Apache-2.0
// Pixels between a host and the resident process: both ways by rows, the top row first, whatever the host's layout is.
#pragma once

#include "../openimageio/resident.h"
#include "host.h"

#include <algorithm>
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

// The values that were used last, by key. Thread-safe.
template<typename Value> class Recent {
public:
    explicit Recent(size_t most) : m_most(most) {}

    std::optional<Value> find(const std::string& key)
    {
        std::lock_guard<std::mutex> guard(m_lock);
        const auto found = std::find_if(m_values.begin(), m_values.end(), [&](const auto& one) { return one.first == key; });
        if (found == m_values.end())
            return std::nullopt;
        std::rotate(found, found + 1, m_values.end());
        return m_values.back().second;
    }
    Value keep(const std::string& key, const Value& value)
    {
        std::lock_guard<std::mutex> guard(m_lock);
        const auto same = [&](const auto& one) { return one.first == key; };
        m_values.erase(std::remove_if(m_values.begin(), m_values.end(), same), m_values.end());
        if (m_values.size() == m_most)
            m_values.erase(m_values.begin());
        return m_values.emplace_back(key, value).second;
    }

private:
    const size_t m_most;
    std::mutex m_lock;
    std::vector<std::pair<std::string, Value>> m_values;  // the last used is the last
};

// Copy an image into the window of another one of the same channels and type; 0 elsewhere.
void copy_image(const HostImage& from, const HostImage& out, const ofx::RectI& window);

}  // namespace oiiotex
