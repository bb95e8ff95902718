// SPDX-License-Identifier: Apache-2.0
// What the host provides, as C++: properties, parameters, clips and images of an effect.
#pragma once

#include "ofx.h"

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

namespace oiiotex {

struct Suites {
    const ofx::PropertySuite* property   = nullptr;
    const ofx::EffectSuite* effect       = nullptr;
    const ofx::ParameterSuite* parameter = nullptr;
    const ofx::MessageSuite* message     = nullptr;  // nullptr: the host has none
    const ofx::ProgressSuite* progress   = nullptr;  // likewise
};
extern Suites suites;

// A set of properties. What a host does not know, it does not set; what it does not have, is the default.
class Properties {
public:
    Properties(void* set = nullptr) : m_set(set) {}
    void set(const char* name, const char* value, int index = 0) const { suites.property->set_string(m_set, name, index, value); }
    void set(const char* name, const std::string& value, int index = 0) const { set(name, value.c_str(), index); }
    void set(const char* name, int value, int index = 0) const { suites.property->set_int(m_set, name, index, value); }
    void set(const char* name, double value, int index = 0) const { suites.property->set_double(m_set, name, index, value); }
    void reset(const char* name) const { suites.property->reset(m_set, name); }
    std::string text(const char* name, int index = 0) const;
    int integer(const char* name, int index = 0, int other = 0) const;
    double real(const char* name, int index = 0, double other = 0) const;
    void* pointer(const char* name) const;
    ofx::RectI rectangle(const char* name) const;

private:
    void* m_set;
};

// Of a clip or an image: 4, 3 or 1, and "float", "half" or "uint8"; 0 and empty for others.
int channels_of(const Properties& properties);
std::string type_of(const Properties& properties);

// An image of a clip, released with the object. Hosts look properties up by name, so that they are read once.
class HostImage {
public:
    ofx::RectI bounds {}, definition {};
    int channels = 0;  // as of channels_of and type_of
    std::string type;
    bool unpremultiplied = false;
    size_t pixel_bytes = 0;

    HostImage(void* clip, double time, const ofx::RectD* region);
    explicit operator bool() const { return m_data && pixel_bytes; }
    char* row(int y) const { return m_data + (y - bounds.y1) * m_stride; }  // the pixel (bounds.x1, y)

private:
    std::shared_ptr<void> m_image;
    char* m_data       = nullptr;
    ptrdiff_t m_stride = 0;
};

// A clip of an effect.
struct Clip {
    void* handle = nullptr;
    Properties properties;

    bool connected() const { return handle && properties.integer("OfxImageClipPropConnected"); }
    std::optional<ofx::RectD> definition(double time) const;
};

// An effect, or its description.
class Effect {
public:
    explicit Effect(const void* handle) : m_handle(const_cast<void*>(handle)) {}
    Properties properties() const;
    Properties define_clip(const std::string& name) const;
    Properties define_parameter(const char* type, const std::string& name) const;
    Clip clip(const std::string& name) const;

    std::string text(const std::string& parameter, double time) const;
    int integer(const std::string& parameter, double time) const { return value<int>(parameter, time); }
    double real(const std::string& parameter, double time) const { return value<double>(parameter, time); }
    void pair(const std::string& parameter, double time, int* x, int* y) const;
    Properties parameter_properties(const char* name) const;
    void set_text(const char* parameter, const std::string& value) const;
    void set_integer(const char* parameter, int value) const;

    bool aborted() const { return suites.effect->aborted(m_handle); }
    void show_error(const std::string& text) const;  // until it is cleared
    void clear_error() const;
    void* handle() const { return m_handle; }

private:
    void* m_handle;

    void* parameter(const char* name, void** properties = nullptr) const;

    // 0 or nullptr if the host has no such parameter.
    template<typename Value> Value value(const std::string& name, double time) const
    {
        Value result {};
        if (void* found = parameter(name.c_str()))
            suites.parameter->value_at(found, time, &result);
        return result;
    }
};

}  // namespace oiiotex
