// SPDX-License-Identifier: Apache-2.0
#include "host.h"

namespace oiiotex {

Suites suites;

std::string Properties::text(const char* name, int index) const
{
    char* value = nullptr;
    const bool known = m_set && suites.property->get_string(m_set, name, index, &value) == ofx::ok && value;
    return known ? value : "";
}

int Properties::integer(const char* name, int index, int other) const
{
    int value = other;
    return m_set && suites.property->get_int(m_set, name, index, &value) == ofx::ok ? value : other;
}

double Properties::real(const char* name, int index, double other) const
{
    double value = other;
    return m_set && suites.property->get_double(m_set, name, index, &value) == ofx::ok ? value : other;
}

void* Properties::pointer(const char* name) const
{
    void* value = nullptr;
    return m_set && suites.property->get_pointer(m_set, name, 0, &value) == ofx::ok ? value : nullptr;
}

ofx::RectI Properties::rectangle(const char* name) const
{
    return { integer(name, 0), integer(name, 1), integer(name, 2), integer(name, 3) };
}

int channels_of(const Properties& properties)
{
    const std::string name = properties.text("OfxImageEffectPropComponents");
    return name == "OfxImageComponentRGBA" ? 4 : name == "OfxImageComponentRGB" ? 3 : name == "OfxImageComponentAlpha";
}

std::string type_of(const Properties& properties)
{
    const std::string name = properties.text("OfxImageEffectPropPixelDepth");
    return name == "OfxBitDepthFloat"  ? "float"
           : name == "OfxBitDepthHalf" ? "half"
           : name == "OfxBitDepthByte" ? "uint8"
                                       : "";
}

HostImage::HostImage(void* clip, double time, const ofx::RectD* region)
{
    void* image = nullptr;
    if (!clip || suites.effect->image(clip, time, region, &image) != ofx::ok || !image)
        return;
    m_image = std::shared_ptr<void>(image, [](void* taken) { suites.effect->release(taken); });
    const Properties own(image);
    bounds = definition = own.rectangle("OfxImagePropBounds");
    const ofx::RectI whole = own.rectangle("OfxImagePropRegionOfDefinition");
    if (whole.x2 > whole.x1 && whole.y2 > whole.y1)
        definition = whole;
    channels    = channels_of(own);
    type        = type_of(own);
    unpremultiplied = channels == 4 && own.text("OfxImageEffectPropPreMultiplication") == "OfxImageAlphaUnPremultiplied";
    pixel_bytes = channels * (type == "float" ? 4 : type == "half" ? 2 : type == "uint8");
    m_data      = static_cast<char*>(own.pointer("OfxImagePropData"));
    m_stride    = own.integer("OfxImagePropRowBytes");
}

std::optional<ofx::RectD> Clip::definition(double time) const
{
    ofx::RectD region {};
    if (!handle || suites.effect->region_of_definition(handle, time, &region) != ofx::ok || region.x2 <= region.x1
        || region.y2 <= region.y1)
        return std::nullopt;
    return region;
}

Properties Effect::properties() const
{
    void* set = nullptr;
    suites.effect->properties(m_handle, &set);
    return Properties(set);
}

Properties Effect::define_clip(const std::string& name) const
{
    void* set = nullptr;
    suites.effect->define_clip(m_handle, name.c_str(), &set);
    return Properties(set);
}

Properties Effect::define_parameter(const char* type, const std::string& name) const
{
    void *parameters = nullptr, *set = nullptr;
    suites.effect->parameters(m_handle, &parameters);
    suites.parameter->define(parameters, type, name.c_str(), &set);
    return Properties(set);
}

Clip Effect::clip(const std::string& name) const
{
    void *clip = nullptr, *set = nullptr;
    if (suites.effect->clip(m_handle, name.c_str(), &clip, &set) != ofx::ok)
        return {};
    return { clip, Properties(set) };
}

void* Effect::parameter(const char* name, void** properties) const
{
    void *parameters = nullptr, *found = nullptr;
    suites.effect->parameters(m_handle, &parameters);
    return suites.parameter->parameter(parameters, name, &found, properties) == ofx::ok ? found : nullptr;
}

Properties Effect::parameter_properties(const char* name) const
{
    void* set = nullptr;
    return parameter(name, &set) ? Properties(set) : Properties();
}

std::string Effect::text(const std::string& name, double time) const
{
    const char* const value = this->value<char*>(name, time);
    return value ? value : "";
}

void Effect::pair(const std::string& name, double time, int* x, int* y) const
{
    *x = *y = 0;
    if (void* found = parameter(name.c_str()))
        suites.parameter->value_at(found, time, x, y);
}

void Effect::set_text(const char* name, const std::string& value) const
{
    if (void* found = parameter(name))
        suites.parameter->set(found, value.c_str());
}

void Effect::set_integer(const char* name, int value) const
{
    if (void* found = parameter(name))
        suites.parameter->set(found, value);
}

void Effect::show_error(const std::string& text) const
{
    if (suites.message)
        suites.message->set_persistent(m_handle, "OfxMessageError", "", "%s", text.c_str());
}

void Effect::clear_error() const
{
    if (suites.message)
        suites.message->clear_persistent(m_handle);
}

}  // namespace oiiotex
