// SPDX-License-Identifier: Apache-2.0
#include "resident.h"

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace oiiotex {
namespace {

constexpr char magic[4]      = { 'o', 'x', 's', 1 };  // VERSION of messages.py
constexpr uint32_t most_text = 16 << 20;              // bytes of a message
constexpr int most_memories  = 64;                    // of a message
constexpr size_t most_word   = 64 << 10;              // bytes of a request to the door; Linux allows 128 KB
constexpr int start_seconds  = 60;                    // until the process must listen
constexpr int reply_seconds  = 600;                   // without any message
constexpr int watch_ms       = 25;                    // between two calls of a Watch

std::string in_words(const char* task)
{
    return std::string(task) + ": " + std::strerror(errno);
}

// Wait until the descriptor can be read; false after `seconds`.
bool readable(int descriptor, int seconds, const Watch& watch)
{
    pollfd waiting { descriptor, POLLIN, 0 };
    for (long left = seconds * 1000L; left > 0;) {
        const int step  = watch ? watch_ms : int(left);
        const int ready = poll(&waiting, 1, step);
        if (ready > 0)
            return true;
        if (watch && !watch(-1))
            throw Canceled();
        left -= ready == 0 ? step : 0;
    }
    return false;
}

// A connection. One thread at a time uses it.
class Link {
public:
    // nullptr if no process listens.
    static std::unique_ptr<Link> to(const std::string& path)
    {
        sockaddr_un address {};
        address.sun_family = AF_UNIX;
        if (path.size() >= sizeof address.sun_path)
            throw Error(path + " is too long for a socket: set XDG_RUNTIME_DIR to a shorter folder");
        std::memcpy(address.sun_path, path.data(), path.size());
        Descriptor socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
        if (socket.number() < 0)
            throw Error(in_words("no socket"));
        if (connect(socket.number(), reinterpret_cast<sockaddr*>(&address), sizeof address))
            return nullptr;
        ucred other {};
        socklen_t size = sizeof other;
        if (getsockopt(socket.number(), SOL_SOCKET, SO_PEERCRED, &other, &size) || other.uid != geteuid())
            throw Error(path + " belongs to another user: remove it, or set XDG_RUNTIME_DIR to a private folder");
        return std::unique_ptr<Link>(new Link(std::move(socket)));
    }

    // A host that forks shares the socket with its child, which would read the parent's answers.
    bool usable() const { return m_owner == getpid(); }

    Reply ask(const std::string& request, const std::vector<Sent>& pixels, const Watch& watch)
    {
        send(request, pixels);
        for (;;) {
            Reply reply             = receive(watch);
            const std::string state = reply.facts.at("state");
            if (state == "done")
                return reply;
            if (state == "failed")
                throw Error(reply.facts.at("text"));
            if (state == "canceled")
                throw Error("the oiiotex process canceled the request");
            if (state == "progress" && watch) {
                const double total = reply.facts.at("total");
                if (!watch(total > 0 ? double(reply.facts.at("done")) / total : -1))
                    throw Canceled();
            }
        }
    }

private:
    Descriptor m_socket;
    pid_t m_owner = getpid();

    explicit Link(Descriptor socket) : m_socket(std::move(socket)) {}

    void send(const std::string& text, const std::vector<Sent>& pixels)
    {
        const uint32_t length = text.size();  // x86 and ARM are little-endian, as the message is
        std::string header(magic, sizeof magic);
        header.append(reinterpret_cast<const char*>(&length), sizeof length);
        iovec piece { header.data(), header.size() };
        msghdr message {};
        message.msg_iov    = &piece;
        message.msg_iovlen = 1;
        alignas(cmsghdr) char control[CMSG_SPACE(most_memories * sizeof(int))] {};
        if (!pixels.empty()) {
            message.msg_control    = control;
            message.msg_controllen = CMSG_SPACE(pixels.size() * sizeof(int));
            cmsghdr* part          = CMSG_FIRSTHDR(&message);
            part->cmsg_level       = SOL_SOCKET;
            part->cmsg_type        = SCM_RIGHTS;
            part->cmsg_len         = CMSG_LEN(pixels.size() * sizeof(int));
            for (size_t n = 0; n < pixels.size(); ++n) {
                const int number = pixels[n].memory.number();
                std::memcpy(CMSG_DATA(part) + n * sizeof number, &number, sizeof number);
            }
        }
        if (sendmsg(m_socket.number(), &message, MSG_NOSIGNAL) != ssize_t(header.size()))
            throw Ended();
        for (size_t at = 0; at < text.size();) {
            const ssize_t count = ::send(m_socket.number(), text.data() + at, text.size() - at, MSG_NOSIGNAL);
            if (count < 0 && errno != EINTR)
                throw Ended();
            at += count > 0 ? count : 0;
        }
    }

    Reply receive(const Watch& watch)
    {
        std::vector<Descriptor> memories;
        char header[sizeof magic + sizeof(uint32_t)];
        exactly(header, sizeof header, &memories, watch);
        uint32_t length;
        std::memcpy(&length, header + sizeof magic, sizeof length);
        if (std::memcmp(header, magic, sizeof magic) || length > most_text)
            throw Error("the oiiotex process has another version: rebuild the plugin");
        std::string text(length, 0);
        exactly(text.data(), length, &memories, watch);
        Reply reply;
        reply.facts = Json::parse(text);
        if (memories.size() != reply.facts.at("arrays").size())
            throw Error("a message of the oiiotex process lacks its pixels");
        if (!memories.empty())
            reply.memory = std::move(memories.front());
        return reply;
    }

    void exactly(char* to, size_t size, std::vector<Descriptor>* memories, const Watch& watch)
    {
        alignas(cmsghdr) char control[CMSG_SPACE(most_memories * sizeof(int))];
        for (size_t at = 0; at < size;) {
            iovec piece { to + at, size - at };
            msghdr message {};
            message.msg_iov        = &piece;
            message.msg_iovlen     = 1;
            message.msg_control    = control;
            message.msg_controllen = sizeof control;
            if (!readable(m_socket.number(), reply_seconds, watch))
                throw Error("the oiiotex process does not respond");
            const ssize_t count = recvmsg(m_socket.number(), &message, MSG_CMSG_CLOEXEC);
            if (count < 0 && errno == EINTR)
                continue;
            if (count <= 0)
                throw Ended();
            at += count;
            for (cmsghdr* part = CMSG_FIRSTHDR(&message); part; part = CMSG_NXTHDR(&message, part))
                if (part->cmsg_level == SOL_SOCKET && part->cmsg_type == SCM_RIGHTS)
                    for (size_t n = 0; n < (part->cmsg_len - CMSG_LEN(0)) / sizeof(int); ++n) {
                        int number;
                        std::memcpy(&number, CMSG_DATA(part) + n * sizeof number, sizeof number);
                        memories->emplace_back(number);
                    }
            if (memories->size() > most_memories)
                throw Error("invalid message from the oiiotex process");
        }
    }
};

// Idle connections, by socket. Never destroyed: hosts may read while they exit.
struct Pool {
    std::mutex lock;
    std::map<std::string, std::vector<std::unique_ptr<Link>>> idle;

    static Pool& get()
    {
        static Pool* pool = new Pool;
        return *pool;
    }

    std::unique_ptr<Link> take(const std::string& socket)
    {
        std::lock_guard<std::mutex> guard(lock);
        auto& links = idle[socket];
        while (!links.empty()) {
            auto link = std::move(links.back());
            links.pop_back();
            if (link->usable())
                return link;
        }
        return nullptr;
    }

    void give(const std::string& socket, std::unique_ptr<Link> link)
    {
        std::lock_guard<std::mutex> guard(lock);
        idle[socket].push_back(std::move(link));
    }

    void forget(const std::string& socket)
    {
        std::lock_guard<std::mutex> guard(lock);
        idle[socket].clear();
    }
};

// The environment without what a host sets for its own libraries and its own Python.
std::vector<char*> plain_environment()
{
    std::vector<char*> kept;
    for (char** one = environ; *one; ++one)
        if (std::strncmp(*one, "LD_LIBRARY_PATH=", 16) && std::strncmp(*one, "LD_PRELOAD=", 11))
            kept.push_back(*one);
    kept.push_back(nullptr);
    return kept;
}

// The output of a program, both streams; a program that takes too long, or is no longer wanted, is killed.
std::string printed_by(const std::vector<std::string>& words, const Watch& watch)
{
    int ends[2];
    if (pipe2(ends, O_CLOEXEC))
        throw Error(in_words("no pipe"));
    Descriptor reading(ends[0]), writing(ends[1]);
    std::vector<char*> arguments;
    for (const std::string& word : words)
        arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, writing.number(), 1);
    posix_spawn_file_actions_adddup2(&actions, writing.number(), 2);
    pid_t child;
    const int problem = posix_spawn(&child, arguments[0], &actions, nullptr, arguments.data(),
                                    plain_environment().data());
    posix_spawn_file_actions_destroy(&actions);
    if (problem)
        throw Error(words[0] + ": " + std::strerror(problem) + ": set OIIOTEX_PYTHON to a Python with oiiotex");
    writing = Descriptor();
    std::string text;
    char piece[4096];
    bool ended = false, canceled = false;
    while (!ended && text.size() <= most_text) {
        try {
            if (!readable(reading.number(), start_seconds, watch))
                break;
        } catch (const Canceled&) {
            canceled = true;
            break;
        }
        const ssize_t count = read(reading.number(), piece, sizeof piece);
        ended               = count == 0 || (count < 0 && errno != EINTR);
        text.append(piece, count > 0 ? count : 0);
    }
    if (!ended)
        kill(child, SIGKILL);
    while (waitpid(child, nullptr, 0) < 0 && errno == EINTR) {}
    if (canceled)
        throw Canceled();
    return text;
}

// The Python that was named at the build; in a wheel, that of the environment that has this file.
std::string default_python()
{
    Dl_info info;
    if (*OIIOTEX_PYTHON || !dladdr(reinterpret_cast<void*>(&default_python), &info))
        return OIIOTEX_PYTHON;
    std::string path(info.dli_fname);
    for (int folders = 0; folders < OIIOTEX_FOLDERS; ++folders)  // from the environment to this file
        path.resize(path.rfind('/') == std::string::npos ? 0 : path.rfind('/'));
    return path + "/bin/python3";
}

// The door of oiiotex (oiiotex/oiiotool/service/door.py): it starts the process of a texture unless one is running.
Json ask_door(const Json& question, const Watch& watch = {})
{
    const char* chosen       = std::getenv("OIIOTEX_PYTHON");
    const std::string python = chosen && *chosen ? chosen : default_python();
    if (python[0] != '/')  // otherwise searched in the host's current folder
        throw Error("OIIOTEX_PYTHON=" + python + ": expected the absolute path of a Python with oiiotex");
    std::string word;
    try {
        word = question.dump();
    } catch (const Json::exception&) {
        throw Error("the file name is not UTF-8");
    }
    if (word.size() > most_word)
        throw Error("the file name is too long: expected at most 4096 characters, and 1000 after '?'");
    const std::string text   = printed_by({ python, "-I", "-m", "oiiotex.oiiotool.service.door", word },
                                        watch);
    const Json answer        = Json::parse(text, nullptr, false);
    if (!answer.is_object()) {
        const size_t end   = text.find_last_not_of('\n') + 1;
        const size_t begin = end ? text.rfind('\n', end - 1) + 1 : 0;
        throw Error(python + " cannot start oiiotex: " + (end ? text.substr(begin, end - begin) : "no output"));
    }
    if (answer.contains("error"))
        throw Error(answer["error"]);
    return answer;
}

}  // namespace

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept
{
    std::swap(m_number, other.m_number);
    return *this;
}

Descriptor::~Descriptor()
{
    if (m_number >= 0)
        close(m_number);
}

void Reply::copy_pixels(void* to, size_t bytes) const
{
    struct stat status;
    if (memory.number() < 0 || fstat(memory.number(), &status) || size_t(status.st_size) != bytes)
        throw Error("the oiiotex process sent other pixels than requested");
    for (size_t at = 0; at < bytes;) {  // read, not mapped: truncated memory cannot crash the host
        const ssize_t count = pread(memory.number(), static_cast<char*>(to) + at, bytes - at, at);
        if (count < 0 && errno == EINTR)
            continue;
        if (count <= 0)
            throw Error(in_words("cannot read pixels of the oiiotex process"));
        at += count;
    }
}

Process::Process(Json question, std::string socket) : m_question(std::move(question)), m_socket(std::move(socket)) {}

std::string Process::socket(bool start, const Watch& watch)
{
    while (!m_starting.try_lock_for(std::chrono::milliseconds(watch_ms)))
        if (watch && !watch(-1))
            throw Canceled();
    std::lock_guard<std::timed_mutex> guard(m_starting, std::adopt_lock);
    if (m_socket.empty() || (start && !Link::to(m_socket)))
        m_socket = ask_door(m_question, watch).at("socket");
    return m_socket;
}

Reply Process::ask(Json request, const std::vector<Sent>& pixels, const Watch& watch)
{
    Pool& pool                = Pool::get();
    const std::string address = socket(false, watch);
    auto link                 = pool.take(address);
    if (!link)
        link = Link::to(address);
    if (!link)
        link = Link::to(socket(true, watch));
    if (!link)
        throw Ended();
    request.update({ { "id", 1 }, { "arrays", Json::array() } });
    for (const Sent& one : pixels)
        request["arrays"].push_back(one.layout);
    try {
        Reply reply = link->ask(request.dump(), pixels, watch);
        pool.give(address, std::move(link));
        return reply;
    } catch (const Ended&) {
        pool.forget(address);  // other connections lead to the same process
        throw;
    }
}

Texture::Texture(const Json& answer)
    : m_text(answer.at("texture"))
    , m_process({ { "texture", m_text } }, answer.at("socket"))
{
}

Json Texture::opened(const std::string& name)
{
    return ask_door({ { "name", name } });
}

Reply Texture::ask(const std::string& what, Json request)
{
    request.update({ { "priority", 2 }, { "do", what }, { "texture", m_text } });
    return m_process.ask(std::move(request));
}

}  // namespace oiiotex
