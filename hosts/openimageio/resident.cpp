// SPDX-License-Identifier: Apache-2.0
#include "resident.h"

#include <cerrno>
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

// The process has ended, as opposed to an error of a request.
struct Ended : Error {
    Ended() : Error("the oiiotex process has ended; the next read starts another one") {}
};

std::string in_words(const char* task)
{
    return std::string(task) + ": " + std::strerror(errno);
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
        const timeval patience { reply_seconds, 0 };
        setsockopt(socket.number(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        return std::unique_ptr<Link>(new Link(std::move(socket)));
    }

    // A host that forks shares the socket with its child, which would read the parent's answers.
    bool usable() const { return m_owner == getpid(); }

    Reply ask(const std::string& request)
    {
        send(request);
        for (;;) {
            Reply reply             = receive();
            const std::string state = reply.facts.at("state");
            if (state == "done")
                return reply;
            if (state == "failed")
                throw Error(reply.facts.at("text"));
            if (state == "canceled")
                throw Error("the oiiotex process canceled the request");
        }
    }

private:
    Descriptor m_socket;
    pid_t m_owner = getpid();

    explicit Link(Descriptor socket) : m_socket(std::move(socket)) {}

    void send(const std::string& text)
    {
        const uint32_t length = text.size();  // x86 and ARM are little-endian, as the message is
        std::string message(magic, sizeof magic);
        message.append(reinterpret_cast<const char*>(&length), sizeof length);
        message += text;
        for (size_t at = 0; at < message.size();) {
            const ssize_t count = ::send(m_socket.number(), message.data() + at, message.size() - at, MSG_NOSIGNAL);
            if (count < 0 && errno != EINTR)
                throw Ended();
            at += count > 0 ? count : 0;
        }
    }

    Reply receive()
    {
        std::vector<Descriptor> memories;
        char header[sizeof magic + sizeof(uint32_t)];
        exactly(header, sizeof header, &memories);
        uint32_t length;
        std::memcpy(&length, header + sizeof magic, sizeof length);
        if (std::memcmp(header, magic, sizeof magic) || length > most_text)
            throw Error("the oiiotex process has another version: rebuild the plugin");
        std::string text(length, 0);
        exactly(text.data(), length, &memories);
        Reply reply;
        reply.facts = Json::parse(text);
        if (memories.size() != reply.facts.at("arrays").size())
            throw Error("a message of the oiiotex process lacks its pixels");
        if (!memories.empty())
            reply.memory = std::move(memories.front());
        return reply;
    }

    void exactly(char* to, size_t size, std::vector<Descriptor>* memories)
    {
        alignas(cmsghdr) char control[CMSG_SPACE(most_memories * sizeof(int))];
        for (size_t at = 0; at < size;) {
            iovec piece { to + at, size - at };
            msghdr message {};
            message.msg_iov        = &piece;
            message.msg_iovlen     = 1;
            message.msg_control    = control;
            message.msg_controllen = sizeof control;
            const ssize_t count    = recvmsg(m_socket.number(), &message, MSG_CMSG_CLOEXEC);
            if (count < 0 && errno == EINTR)
                continue;
            if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
                throw Error("the oiiotex process does not respond");
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

// The output of a program, both streams; a program that takes too long is killed.
std::string printed_by(const std::vector<std::string>& words)
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
    const int problem = posix_spawn(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (problem)
        throw Error(words[0] + ": " + std::strerror(problem) + ": set OIIOTEX_PYTHON to a Python with oiiotex");
    writing = Descriptor();
    std::string text;
    char piece[4096];
    for (pollfd waiting { reading.number(), POLLIN, 0 };;) {
        const int ready = poll(&waiting, 1, start_seconds * 1000);
        if (ready < 0 && errno == EINTR)
            continue;
        const ssize_t count = ready > 0 ? read(reading.number(), piece, sizeof piece) : 0;
        if (ready == 0)
            kill(child, SIGKILL);
        if (count <= 0)
            break;
        text.append(piece, count);
        if (text.size() > most_text) {
            kill(child, SIGKILL);
            break;
        }
    }
    while (waitpid(child, nullptr, 0) < 0 && errno == EINTR) {}
    return text;
}

// The Python that was named at the build; in a wheel, that of the environment whose lib/oiiotex has this file.
std::string default_python()
{
    Dl_info info;
    if (*OIIOTEX_PYTHON || !dladdr(reinterpret_cast<void*>(&default_python), &info))
        return OIIOTEX_PYTHON;
    std::string path(info.dli_fname);
    for (int folders = 0; folders < 3; ++folders)
        path.resize(path.rfind('/') == std::string::npos ? 0 : path.rfind('/'));
    return path + "/bin/python3";
}

// The door of oiiotex (oiiotex/oiiotool/service/door.py): it starts the process of a texture unless one is running.
Json ask_door(const Json& question)
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
    const std::string text   = printed_by({ python, "-I", "-m", "oiiotex.oiiotool.service.door", word });
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

Texture::Texture(const std::string& name)
{
    const Json answer = ask_door({ { "name", name } });
    m_text            = answer.at("texture");
    m_socket          = answer.at("socket");
}

Reply Texture::ask(const std::string& what, Json request)
{
    Pool& pool = Pool::get();
    auto link  = pool.take(m_socket);
    if (!link)
        link = Link::to(m_socket);
    if (!link) {
        static std::mutex starting;  // only one thread restarts an ended process
        std::lock_guard<std::mutex> guard(starting);
        link = Link::to(m_socket);
        if (!link) {
            ask_door({ { "texture", m_text } });
            link = Link::to(m_socket);
        }
        if (!link)
            throw Ended();
    }
    try {
        request.update({ { "id", 1 }, { "priority", 2 }, { "arrays", Json::array() }, { "do", what },
                         { "texture", m_text } });
        Reply reply = link->ask(request.dump());
        pool.give(m_socket, std::move(link));
        return reply;
    } catch (const Ended&) {
        pool.forget(m_socket);  // other connections lead to the same process
        throw;
    }
}

}  // namespace oiiotex
