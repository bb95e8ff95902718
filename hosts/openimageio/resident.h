// SPDX-License-Identifier: Apache-2.0
// Client of oiiotex's resident process in C++, with the messages of oiiotex/oiiotool/service/messages.py.
#pragma once

#include <cstddef>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace oiiotex {

using Json = nlohmann::json;  // throws a std::exception for an invalid message

// An error in one line, for the user of the host.
struct Error : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The process has ended, as opposed to an error of a request.
struct Ended : Error {
    Ended() : Error("the oiiotex process has ended; the next read starts another one") {}
};

// The host has canceled a request.
struct Canceled : Error {
    Canceled() : Error("canceled") {}
};

// Called while a request is pending, at least 30 times per second: false cancels it. Its argument is the share that is
// done, or negative if that is not known.
using Watch = std::function<bool(double)>;

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

// Pixels of a request: sealed memory, and its layout as JSON.
struct Sent {
    Descriptor memory;
    Json layout;
};

// The resident process, which is started if necessary. Thread-safe.
class Process {
public:
    // `question` to the door starts the process that listens at `socket`; empty: the door's answer says where.
    explicit Process(Json question, std::string socket = "");

    // The answer to a request. Throws Error; if the process has ended, the next request starts another one.
    Reply ask(Json request, const std::vector<Sent>& pixels = {}, const Watch& watch = {});

private:
    Json m_question;
    std::timed_mutex m_starting;  // only one thread restarts an ended process
    std::string m_socket;         // once it is known, it is constant

    std::string socket(bool start, const Watch& watch);
};

// A texture file in the resident process. Thread-safe.
class Texture {
public:
    // By file name, with a query after '?'. Throws Error if the name or the file is invalid.
    explicit Texture(const std::string& name) : Texture(opened(name)) {}

    // The answer to a request about this texture, with further members `request`, as of `Process`.
    Reply ask(const std::string& what, Json request = Json::object());

private:
    std::string m_text;  // identifies the texture for the process
    Process m_process;

    explicit Texture(const Json& answer);
    static Json opened(const std::string& name);
};

}  // namespace oiiotex
