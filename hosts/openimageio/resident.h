// SPDX-License-Identifier: Apache-2.0
// The resident process of oiiotex, asked from C++: messages as oiiotex/service/messages.py has them.
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

#include <nlohmann/json.hpp>

namespace oiiotex {

using Json = nlohmann::json;  // throws what is a std::exception where a message is not as it should be

// In one line, for who uses the host.
struct Error : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// A descriptor that is closed with it.
class Descriptor {
public:
    explicit Descriptor(int number = -1) : m_number(number) {}
    Descriptor(Descriptor&& other) noexcept : m_number(other.m_number) { other.m_number = -1; }
    Descriptor& operator=(Descriptor&& other) noexcept;
    ~Descriptor();
    int number() const { return m_number; }

private:
    int m_number;
};

// What was answered: facts, and the pixels that came with them.
struct Reply {
    Json facts;
    Descriptor memory;

    // Copy the pixels, which are `bytes` of this numpy type, (height, width, channels).
    void copy_pixels(void* to, size_t bytes) const;
};

// A texture file in the resident process, which is started where none runs. Any thread may ask.
class Texture {
public:
    // By its name, with what stands behind '?' in it. Throws Error where it, or something in it, is wrong.
    explicit Texture(const std::string& name);

    // The answer to a request about this texture, of which `request` are further members.
    // Throws Error: where the process has ended, what is asked next starts another one.
    Reply ask(const std::string& what, Json request = Json::object());

private:
    std::string m_text;    // by which the process knows the texture
    std::string m_socket;  // where that process listens; it does not change
};

}  // namespace oiiotex
