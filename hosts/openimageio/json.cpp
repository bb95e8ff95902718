// SPDX-License-Identifier: Apache-2.0
#include "json.h"

#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace oiiotex {
namespace {

constexpr int most_depth = 32;  // lists and objects in each other

class Reader {
public:
    explicit Reader(const std::string& text) : m_at(text.data()), m_end(m_at + text.size()) {}

    Json whole_text()
    {
        Json value = read(0);
        skip_spaces();
        if (m_at != m_end)
            fail();
        return value;
    }

private:
    const char* m_at;
    const char* m_end;

    [[noreturn]] static void fail() { throw std::runtime_error("what came from oiiotex is no message"); }

    void skip_spaces()
    {
        while (m_at != m_end && std::strchr(" \t\r\n", *m_at) && *m_at)
            ++m_at;
    }

    char next()
    {
        if (m_at == m_end)
            fail();
        return *m_at++;
    }

    // Whether that character is next, behind spaces; it is then passed.
    bool passed(char wanted)
    {
        skip_spaces();
        if (m_at == m_end || *m_at != wanted)
            return false;
        ++m_at;
        return true;
    }

    void require(char wanted)
    {
        if (!passed(wanted))
            fail();
    }

    Json read(int depth)
    {
        if (depth > most_depth)
            fail();
        Json value;
        if (passed('{')) {
            for (bool first = true; !passed('}'); first = false) {
                if (!first)
                    require(',');
                require('"');
                std::string name = string();
                require(':');
                value.members[name] = read(depth + 1);
            }
        } else if (passed('[')) {
            for (bool first = true; !passed(']'); first = false) {
                if (!first)
                    require(',');
                value.items.push_back(read(depth + 1));
            }
        } else if (passed('"')) {
            value.text = string();
        } else {
            const char* begin = m_at;
            while (m_at != m_end && (std::isalnum(static_cast<unsigned char>(*m_at)) || std::strchr("+-.", *m_at)) && *m_at)
                ++m_at;
            if (m_at == begin)
                fail();
            value.text.assign(begin, m_at);
        }
        return value;
    }

    // Behind the quote that opens it.
    std::string string()
    {
        std::string out;
        for (char c = next(); c != '"'; c = next())
            if (c == '\\')
                escaped(out);
            else
                out += c;
        return out;
    }

    void escaped(std::string& out)
    {
        const char c       = next();
        const char* letter = std::strchr("bfnrt", c);
        if (c == 'u')
            code_point(out);
        else if (letter && c)
            out += "\b\f\n\r\t"[letter - "bfnrt"];
        else
            out += c;
    }

    unsigned hexadecimal()
    {
        char digits[5] = {};
        for (int n = 0; n < 4; ++n)
            digits[n] = next();
        char* end      = nullptr;
        unsigned value = std::strtoul(digits, &end, 16);
        if (end != digits + 4)
            fail();
        return value;
    }

    // As UTF-8; two halves of a surrogate pair are one.
    void code_point(std::string& out)
    {
        unsigned code = hexadecimal();
        if (code >= 0xd800 && code < 0xdc00) {
            if (next() != '\\' || next() != 'u')
                fail();
            code = 0x10000 + ((code - 0xd800) << 10) + (hexadecimal() - 0xdc00);
        }
        if (code < 0x80) {
            out += char(code);
            return;
        }
        const int more = code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
        out += char((0xff00 >> (more + 1) & 0xff) | code >> (6 * more));
        for (int n = more - 1; n >= 0; --n)
            out += char(0x80 | (code >> (6 * n) & 0x3f));
    }
};

}  // namespace

const Json& Json::operator[](const std::string& name) const
{
    static const Json nothing;
    auto found = members.find(name);
    return found == members.end() ? nothing : found->second;
}

long long Json::whole() const
{
    char* end       = nullptr;
    long long value = std::strtoll(text.c_str(), &end, 10);
    if (text.empty() || *end)
        throw std::runtime_error("what came from oiiotex is no message");
    return value;
}

Json read_json(const std::string& text)
{
    return Reader(text).whole_text();
}

std::string json_string(const std::string& text)
{
    std::string out = "\"";
    for (char c : text) {
        if (c == '"' || c == '\\') {
            out += '\\';
            out += c;
        } else if (static_cast<unsigned char>(c) < 0x20) {
            char code[8];
            std::snprintf(code, sizeof code, "\\u%04x", c);
            out += code;
        } else {
            out += c;
        }
    }
    return out + '"';
}

}  // namespace oiiotex
