// SPDX-License-Identifier: Apache-2.0
// As much of JSON as messages of the resident process need: read into values, and texts written.
#pragma once

#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace oiiotex {

// A value: what it is not is empty.
struct Json {
    std::string text;                     // of a string; of a number, true, false or null as it is written
    std::vector<Json> items;              // of a list
    std::map<std::string, Json> members;  // of an object

    // The member of that name; an empty value where there is none.
    const Json& operator[](const std::string& name) const;

    // The whole number that it is; throws std::runtime_error where it is none.
    long long whole() const;
};

// Throws std::runtime_error where the text is not JSON.
Json read_json(const std::string& text);

// A string of JSON, with its quotes; bytes beyond ASCII stay as they are.
std::string json_string(const std::string& text);

}  // namespace oiiotex
