// SPDX-License-Identifier: Apache-2.0
// Client of oiiotex's resident process in C++, with the messages of oiiotex/oiiotool/service/messages.py.
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

#include <nlohmann/json.hpp>

namespace oiiotex {

using Json = nlohmann::json;  // throws a std::exception for an invalid message

// An error in one line, for the user of the host.
struct Error : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// A file descriptor, closed with the object.
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

// An answer: facts and pixels.
struct Reply {
    Json facts;
    Descriptor memory;

    // Copy the pixels: `bytes` of this numpy type, (height, width, channels).
    void copy_pixels(void* to, size_t bytes) const;
};

// A texture file in the resident process, which is started if necessary. Thread-safe.
class Texture {
public:
    // By file name, with a query after '?'. Throws Error if the name or the file is invalid.
    explicit Texture(const std::string& name);

    // The answer to a request about this texture, with further members `request`.
    // Throws Error; if the process has ended, the next request starts another one.
    Reply ask(const std::string& what, Json request = Json::object());

private:
    std::string m_text;    // identifies the texture for the process
    std::string m_socket;  // of the process; constant
};

}  // namespace oiiotex
