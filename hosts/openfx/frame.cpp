// SPDX-License-Identifier: Apache-2.0
#include "frame.h"

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

namespace oiiotex {
namespace {

// Fold the 128-bit product of two words: a step of a multiplicative hash.
uint64_t folded(uint64_t a, uint64_t b)
{
    const unsigned __int128 product = static_cast<unsigned __int128>(a) * b;
    return uint64_t(product) ^ uint64_t(product >> 64);
}

constexpr uint64_t salts[4] = { 0x9e3779b97f4a7c15, 0xc2b2ae3d27d4eb4f, 0x165667b19e3779f9, 0xd6e8feb86659fd93 };

// A hash of pixels for a cache of the user's own frames: fast, and not made to resist an attacker.
void add_bytes(const char* bytes, size_t count, uint64_t hash[2])
{
    uint64_t lanes[4] = { hash[0], hash[1], hash[0] ^ salts[2], hash[1] ^ salts[3] };
    char block[64];
    for (size_t at = 0; at < count; at += sizeof block) {
        const char* from = bytes + at;
        if (count - at < sizeof block) {  // the last one, filled with zeros; the request has the size
            std::memset(block, 0, sizeof block);
            std::memcpy(block, from, count - at);
            from = block;
        }
        uint64_t words[8];
        std::memcpy(words, from, sizeof words);
        for (int n = 0; n < 4; ++n)
            lanes[n] = folded(words[2 * n] ^ salts[n], words[2 * n + 1] ^ lanes[n]);
    }
    hash[0] = folded(lanes[0] ^ salts[1], lanes[1] ^ salts[0]) ^ lanes[2];
    hash[1] = folded(lanes[2] ^ salts[3], lanes[3] ^ salts[2]) ^ lanes[0];
}

void write_fully(int file, const char* from, size_t bytes)
{
    while (bytes) {
        const ssize_t count = write(file, from, bytes);
        if (count < 0 && errno == EINTR)
            continue;
        if (count <= 0)
            throw Error("no memory for an image");
        from += count;
        bytes -= count;
    }
}

// Fill the window of `out` from rows of an area: `copy` gets a pointer to `count` pixels of `out` from (x, y).
template<typename Copy>
void fill(const HostImage& out, const ofx::RectI& window, const ofx::RectI& area, const Copy& copy)
{
    const ofx::RectI bounds = out.bounds;
    const size_t bytes      = out.pixel_bytes;
    const int left = std::max(bounds.x1, window.x1), right = std::min(bounds.x2, window.x2);
    const int first = std::clamp(area.x1, left, std::max(left, right));
    const int last  = std::clamp(area.x2, first, std::max(first, right));
    for (int y = std::max(bounds.y1, window.y1); left < right && y < std::min(bounds.y2, window.y2); ++y) {
        char* row         = out.row(y) + (left - bounds.x1) * bytes;
        const bool inside = y >= area.y1 && y < area.y2 && first < last;
        if (!inside || first > left || last < right)
            std::memset(row, 0, (right - left) * bytes);
        if (inside)
            copy(row + (first - left) * bytes, first, y, last - first);
    }
}

}  // namespace

Json image_facts(const std::string& slot, const ofx::RectI& bounds, const ofx::RectI& whole, int channels,
                 const std::string& type, const std::string& space, bool unpremultiplied)
{
    Json names = channels == 1 ? Json { "Y" } : Json { "R", "G", "B" };
    if (channels == 4)
        names.push_back("A");
    Json attributes = Json::array();
    if (!space.empty())
        attributes.push_back({ "oiio:ColorSpace", "string", space });
    if (unpremultiplied)
        attributes.push_back({ "oiio:UnassociatedAlpha", "int", 1 });
    const Json place { bounds.x1 - whole.x1, whole.y2 - bounds.y2, bounds.x2 - bounds.x1, bounds.y2 - bounds.y1,
                       0, 0, whole.x2 - whole.x1, whole.y2 - whole.y1 };
    const Json part { { "name", slot },     { "place", place }, { "type", type },
                      { "channels", names }, { "alpha", channels == 4 ? 3 : -1 }, { "stored", type },
                      { "exact", false },   { "attributes", attributes } };
    return { { "slot", slot }, { "image", { { "source", slot }, { "parts", Json::array({ part }) } } } };
}

Json Input::facts(const std::string& space) const
{
    return image_facts(slot, image.bounds, image.definition, mask ? 1 : image.channels, image.type, space,
                       image.unpremultiplied && !mask);
}

void Input::add_to(uint64_t hash[2]) const
{
    const ofx::RectI bounds = image.bounds;
    for (int y = bounds.y2 - 1; y >= bounds.y1; --y)
        add_bytes(image.row(y), (bounds.x2 - bounds.x1) * image.pixel_bytes, hash);
}

Sent Input::sent() const
{
    const ofx::RectI bounds = image.bounds;
    const int width = bounds.x2 - bounds.x1, channels = image.channels, kept = mask ? 1 : channels;
    const size_t bytes = image.pixel_bytes, sample = bytes / channels, skipped = channels == 4 ? 3 * sample : 0;
    Descriptor memory(memfd_create("oiiotex", MFD_CLOEXEC | MFD_ALLOW_SEALING));
    if (memory.number() < 0)
        throw Error("no memory for an image");
    std::vector<char> row(width * kept * sample);
    for (int y = bounds.y2 - 1; y >= bounds.y1; --y) {
        const char* from = image.row(y);
        if (kept < channels) {
            for (int x = 0; x < width; ++x)
                std::memcpy(&row[x * sample], from + x * bytes + skipped, sample);
            from = row.data();
        }
        write_fully(memory.number(), from, row.size());
    }
    fcntl(memory.number(), F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE);
    const std::string type = image.type;
    return { std::move(memory), { { "type", type == "float" ? "<f4" : type == "half" ? "<f2" : "|u1" },
                                  { "shape", { bounds.y2 - bounds.y1, width, kept } } } };
}

std::string key_of(const Json& request, const std::vector<Input>& inputs)
{
    uint64_t hash[2] { salts[0], salts[1] };
    const std::string text = request.dump();
    add_bytes(text.data(), text.size(), hash);
    for (const Input& input : inputs)
        input.add_to(hash);
    char key[33];
    std::snprintf(key, sizeof key, "%016llx%016llx", static_cast<unsigned long long>(hash[0]),
                  static_cast<unsigned long long>(hash[1]));
    return key;
}

Frame::Frame(const Reply& reply) : facts(reply.facts)
{
    const int file  = reply.memory.number();
    const off_t end = file < 0 ? 0 : lseek(file, 0, SEEK_END);
    const int seals = file < 0 ? -1 : fcntl(file, F_GET_SEALS);
    if (end <= 0 || seals < 0 || !(seals & F_SEAL_SHRINK))  // memory that shrinks would crash the host
        throw Error("the oiiotex process sent no pixels");
    void* pixels = mmap(nullptr, end, PROT_READ, MAP_SHARED | MAP_POPULATE, file, 0);
    if (pixels == MAP_FAILED)
        throw Error("no memory for an image");
    m_bytes  = end;
    m_pixels = { static_cast<const char*>(pixels), [end](const char* from) { munmap(const_cast<char*>(from), end); } };
}

void Frame::copy(int x, int y, const HostImage& out, const ofx::RectI& window) const
{
    const int width = facts.at("place").at(2), height = facts.at("place").at(3);
    if (width < 0 || height < 0 || size_t(width) * height * out.pixel_bytes != m_bytes)
        throw Error("the oiiotex process sent other pixels than requested");
    fill(out, window, { x, y, x + width, y + height }, [&](char* to, int left, int row, int count) {
        const size_t at = size_t(y + height - 1 - row) * width + left - x;
        std::memcpy(to, m_pixels.get() + at * out.pixel_bytes, count * out.pixel_bytes);
    });
}

void copy_image(const HostImage& from, const HostImage& out, const ofx::RectI& window)
{
    ofx::RectI area {};
    if (from && from.type == out.type && from.channels == out.channels)
        area = from.bounds;
    fill(out, window, area, [&](char* to, int left, int y, int count) {
        std::memcpy(to, from.row(y) + (left - area.x1) * out.pixel_bytes, count * out.pixel_bytes);
    });
}

}  // namespace oiiotex
