// SPDX-License-Identifier: Apache-2.0
#include "node.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

namespace oiiotex {
namespace {

const char* const depths[]     = { "OfxBitDepthFloat", "OfxBitDepthHalf", "OfxBitDepthByte" };
const char* const components[] = { "OfxImageComponentRGBA", "OfxImageComponentRGB", "OfxImageComponentAlpha" };
const char* const premultiplication = "OfxImageEffectPropPreMultiplication";
const char* const no_space     = "no color space: choose that of Source in colorspace; for maps other than color, set data";

std::string number(double value)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", value);
    return text;
}

// A value in pixels of the full size, at a render scale; never less than the smallest that is declared.
double scaled(double value, double scale, const Json& parameter)
{
    const Json& least = parameter.at("least");
    return least.is_null() ? value * scale : std::max(value * scale, least.get<double>());
}

// Comma-separated numbers in pixels, at a render scale.
std::string scaled_list(const std::string& text, double scale)
{
    std::string result;
    for (size_t at = 0; at <= text.size();) {
        const size_t end = std::min(text.find(',', at), text.size());
        result += (at ? "," : "") + number(std::atof(text.substr(at, end - at).c_str()) * scale);
        at = end + 1;
    }
    return result;
}

// The option of a choice of lengths that is nearest at a render scale.
size_t nearest_option(const Json& options, size_t chosen, double scale)
{
    const double wanted = std::atof(options.at(chosen).get<std::string>().c_str()) * scale;
    size_t best         = chosen;
    for (size_t n = 0; n < options.size(); ++n) {
        const double length = std::atof(options.at(n).get<std::string>().c_str());
        const double found  = std::atof(options.at(best).get<std::string>().c_str());
        if (length > 0 && std::abs(length - wanted) < std::abs(found - wanted))
            best = n;
    }
    return best;
}

// The color config: that of a host of OpenFX 1.5, else $OCIO; empty: the built-in one.
std::string config_of(const Effect& effect)
{
    const std::string of_host = effect.properties().text("OfxImageEffectPropOCIOConfig");
    const char* const set     = std::getenv("OCIO");
    return of_host.empty() && set ? set : of_host;
}

// The process for the color config of an effect's host. Never destroyed: hosts may render while they exit.
Process& process_of(const Effect& effect)
{
    static std::mutex lock;
    static auto& processes   = *new std::map<std::string, std::unique_ptr<Process>>;
    const std::string config = config_of(effect);
    std::lock_guard<std::mutex> guard(lock);
    auto& process = processes[config];
    if (!process) {
        Json question { { "device", nullptr } };
        if (!config.empty())
            question["colorconfig"] = config;
        process = std::make_unique<Process>(question);
    }
    return *process;
}

// Where the pixels of requests lie, by the request without pixels: hosts ask often. Never destroyed.
Recent<Json>& places()
{
    static auto& kept = *new Recent<Json>(1000);
    return kept;
}

// Tells the host how far a request is; its dialog appears with the first report.
class ProgressBar {
public:
    explicit ProgressBar(const Effect& effect) : m_effect(effect) {}
    ~ProgressBar()
    {
        if (m_shown)
            suites.progress->end(m_effect.handle());
    }
    Watch watch()
    {
        return [this](double share) {
            if (share >= 0 && suites.progress) {
                if (!m_shown)
                    suites.progress->start(m_effect.handle(), "oiiotex");
                m_shown = true;
                if (suites.progress->update(m_effect.handle(), share) == ofx::reply_no)
                    return false;
            }
            return !m_effect.aborted();
        };
    }

private:
    const Effect& m_effect;
    bool m_shown = false;
};

void set_region(const Properties& out, const std::string& name, const ofx::RectD& region)
{
    const double sides[] = { region.x1, region.y1, region.x2, region.y2 };
    for (int n = 0; n < 4; ++n)
        out.set(name.c_str(), sides[n], n);
}

// A parameter of the table; returns its properties.
Properties define(const Effect& effect, const Json& parameter)
{
    static const std::map<std::string, const char*> types {
        { "int", "OfxParamTypeInteger" }, { "float", "OfxParamTypeDouble" },   { "bool", "OfxParamTypeBoolean" },
        { "choice", "OfxParamTypeChoice" }, { "string", "OfxParamTypeString" }, { "size", "OfxParamTypeInteger2D" },
        { "button", "OfxParamTypePushButton" },
    };
    const std::string type = parameter.at("type");
    const Properties own   = effect.define_parameter(types.at(type), parameter.at("name"));
    own.set("OfxPropLabel", parameter.at("label").get<std::string>());
    own.set("OfxParamPropHint", parameter.at("help").get<std::string>());
    const bool listed = parameter.at("name") != "spaces" || !std::getenv("OCIO");  // else instances list those of $OCIO
    if (type == "choice")
        for (size_t n = 0; n < (listed ? parameter.at("options").size() : 1); ++n)
            own.set("OfxParamPropChoiceOption", parameter.at("options").at(n).get<std::string>(), int(n));
    if (type == "string")
        own.set("OfxParamPropDefault", parameter.at("default").get<std::string>());
    for (const auto& [name, key] : { std::pair("OfxParamPropDefault", "default"), { "OfxParamPropMin", "min" },
                                     { "OfxParamPropDisplayMin", "min" }, { "OfxParamPropMax", "max" },
                                     { "OfxParamPropDisplayMax", "shown" } })
        for (int n = 0; type != "string" && parameter.contains(key) && n < (type == "size" ? 2 : 1); ++n)
            type == "float" ? own.set(name, parameter.at(key).get<double>(), n)
                            : own.set(name, parameter.at(key).get<int>(), n);
    return own;
}

}  // namespace

ofx::Status Node::describe(const Effect& effect, const Properties&, const Properties&) const
{
    const Properties own = effect.properties();
    own.set("OfxPropLabel", m_facts.at("label").get<std::string>());
    own.set("OfxPropPluginDescription", m_facts.at("help").get<std::string>());
    own.set("OfxImageEffectPluginPropGrouping", "oiiotex");
    int contexts = 0;
    for (const Json& context : m_facts.at("contexts"))
        own.set("OfxImageEffectPropSupportedContexts", "OfxImageEffectContext" + context.get<std::string>(), contexts++);
    for (int n = 0; n < 3; ++n)
        own.set("OfxImageEffectPropSupportedPixelDepths", depths[n], n);
    for (const auto& [name, value] : { std::pair("OfxImageEffectPluginPropSingleInstance", false),
                                       { "OfxImageEffectPluginPropHostFrameThreading", false },
                                       { "OfxImageEffectPropSupportsMultiResolution", true },
                                       { "OfxImageEffectPropSupportsTiles", flag("anywindow") },
                                       { "OfxImageEffectPropTemporalClipAccess", flag("still") } })
        own.set(name, int(value));
    if (m_facts.at("outputs").size() > 1)
        own.set("OfxImageEffectPropClipPreferencesSlaveParam", "output");
    own.set("OfxImageEffectPluginRenderThreadSafety", "OfxImageEffectRenderFullySafe");
    own.set("OfxImageEffectPropOpenCLRenderSupported", "false");  // buffers would have to cross processes
    own.set("OfxImageEffectPropColourManagementStyle", "OfxImageEffectColourManagementOCIO");
    own.set("OfxImageEffectPropColourManagementAvailableConfigs", "ofx-native-v1.5_aces-v1.3_ocio-v2.3");
    return ofx::ok;
}

ofx::Status Node::describe_in_context(const Effect& effect, const Properties& in, const Properties&) const
{
    const std::string context = in.text("OfxImageEffectPropContext");
    const Properties output   = effect.define_clip("Output");
    for (int n = 0; n < 3; ++n)
        output.set("OfxImageEffectPropSupportedComponents", components[n], n);
    for (const Json& input : m_facts.at("inputs")) {
        const std::string clip = input.at("clip");
        if (context == "OfxImageEffectContextFilter" && clip != "Source")
            continue;
        const bool mask      = input.at("mask");
        const Properties own = effect.define_clip(clip);
        own.set("OfxPropLabel", clip);
        own.set("OfxImageClipPropOptional", int(input.at("optional") || context == "OfxImageEffectContextGenerator"));
        own.set("OfxImageClipPropIsMask", int(mask));
        own.set("OfxImageEffectPropTemporalClipAccess", int(flag("still")));
        own.set("OfxImageEffectPropSupportsTiles", 0);
        for (int n = 0; n < 3; ++n)  // of a mask, the host may give alpha alone
            own.set("OfxImageEffectPropSupportedComponents", components[mask ? 2 - n : n], n);
    }
    bool folded = false;
    for (const Json& parameter : m_facts.at("params")) {
        if (parameter.at("advanced") && !folded) {
            const Properties group = effect.define_parameter("OfxParamTypeGroup", "advanced");
            group.set("OfxPropLabel", "Advanced");
            group.set("OfxParamPropGroupOpen", 0);
            folded = true;
        }
        const Properties own = define(effect, parameter);
        if (parameter.at("advanced"))
            own.set("OfxParamPropParent", "advanced");
        if (parameter.at("type") == "string" || parameter.at("type") == "choice")
            own.set("OfxParamPropAnimates", 0);
        if (parameter.at("told")) {  // it tells something, and changes no pixel
            own.set("OfxParamPropAnimates", 0);
            own.set("OfxParamPropEvaluateOnChange", 0);
        }
    }
    return ofx::ok;
}

ofx::Status Node::clip_preferences(const Effect& effect, const Properties&, const Properties& out) const
{
    const Clip source        = effect.clip("Source");
    const std::string state  = source.properties.text(premultiplication);
    const char* const others = output(effect, 0).at("mask") ? "OfxImageAlphaPremultiplied" : "OfxImageOpaque";
    if (!keeps_space(effect))
        out.set(premultiplication, others);
    else if (source.connected() && !state.empty())
        out.set(premultiplication, state);
    if (!source.connected()) {
        out.set("OfxImageClipPropComponents_Output", components[0]);
        out.set("OfxImageClipPropDepth_Output", depths[0]);
    }
    return ofx::ok;
}

bool Node::keeps_space(const Effect& effect) const
{
    return flag("keepsspace") && &output(effect, 0) == &m_facts.at("outputs").at(0);
}

const Json& Node::output(const Effect& effect, double time) const
{
    const Json& outputs = m_facts.at("outputs");
    const int chosen    = outputs.size() > 1 ? effect.integer("output", time) : 0;
    return outputs.at(std::clamp(chosen, 0, int(outputs.size()) - 1));
}

double Node::frame_of(const Effect& effect, const Json& input, double time) const
{
    const std::string clip = input.at("clip");
    if (!flag("still") || !(clip == "Source" || input.at("mask")) || !effect.integer("hold", time))
        return time;
    const double frame     = effect.integer("frame", time);
    const Properties range = effect.clip(clip).properties;
    const double first = range.real("OfxImageEffectPropFrameRange", 0, frame);
    return std::clamp(frame, first, std::max(first, range.real("OfxImageEffectPropFrameRange", 1, frame)));
}

Json Node::values(const Effect& effect, const Moment& moment) const
{
    Json result        = Json::object();
    const double scale = moment.scale_x, time = moment.time;
    for (const Json& parameter : m_facts.at("params")) {
        const std::string name = parameter.at("name"), type = parameter.at("type");
        if (parameter.at("host"))  // not of the op
            continue;
        const double px  = parameter.at("pixels") ? scale : 1;
        const bool moves = px != 1 && !parameter.at("auto");  // a default in pixels, too
        if (type == "choice") {
            const Json& options = parameter.at("options");
            const size_t chosen = std::clamp(effect.integer(name, time), 0, int(options.size()) - 1);
            const size_t used   = px != 1 && options.at(chosen) != "automatic" ? nearest_option(options, chosen, px) : chosen;
            if (used != parameter.at("default"))
                result[name] = options.at(used);
        } else if (type == "size") {
            int width, height;
            effect.pair(name, time, &width, &height);
            if (width > 0 && height > 0)
                result[name] = std::to_string(std::max(1L, std::lround(width * moment.scale_x))) + "x"
                               + std::to_string(std::max(1L, std::lround(height * moment.scale_y)));
        } else if (type == "string") {
            const std::string text = effect.text(name, time);
            if (text != parameter.at("default"))
                result[name] = px == 1 ? text : scaled_list(text, px);
        } else {
            const double value = type == "float" ? effect.real(name, time) : effect.integer(name, time);
            const double used  = px == 1 ? value : scaled(value, px, parameter);
            if (value != parameter.at("default") || moves)
                result[name] = type == "float" ? number(used) : std::to_string(std::lround(used));
        }
    }
    const std::string ask = output(effect, time).at("ask");
    if (!ask.empty())
        result[ask] = "1";
    return result;
}

std::string Node::space(const Effect& effect, double time) const
{
    const std::string chosen = effect.text("colorspace", time);
    if (!chosen.empty())
        return chosen;
    const std::string of_host = effect.clip("Source").properties.text("OfxImageClipPropColourspace");
    const bool is_vague = of_host.rfind("ofx_", 0) == 0 || of_host.rfind("OfxColourspace_", 0) == 0;  // a family, a clip
    return is_vague ? "" : of_host;
}

bool Node::lacks_space(const Effect& effect, double time) const
{
    return flag("color") && !effect.integer("data", time) && space(effect, time).empty();
}

ofx::RectD Node::plane(const Effect& effect, double time) const
{
    int width, height;
    effect.pair("size", time, &width, &height);
    const Properties own = effect.properties();
    const double x = own.real("OfxImageEffectPropProjectOffset", 0), y = own.real("OfxImageEffectPropProjectOffset", 1);
    if (width > 0 && height > 0)
        return { x, y, x + width, y + height };
    return { x, y, x + own.real("OfxImageEffectPropProjectSize", 0, 1920),
             y + own.real("OfxImageEffectPropProjectSize", 1, 1080) };
}

Json Node::request(const Effect& effect, const Moment& moment) const
{
    const Json& shown = output(effect, moment.time);
    Json result { { "op", m_facts.at("op") },     { "values", values(effect, moment) }, { "part", shown.at("part") },
                  { "mask", shown.at("mask") },   { "inputs", Json::array() },          { "priority", 2 } };
    if (shown.at("label") == "Matte")
        result["matte"] = effect.text("matte", moment.time);
    return result;
}

std::string Node::line(const Effect& effect, double time) const
{
    std::string words = "oiiotex", modifiers;
    const std::string space = this->space(effect, time);
    for (const Json& input : m_facts.at("inputs")) {
        const std::string clip = input.at("clip"), without = input.at("without");
        const bool connected = effect.clip(clip).connected();
        if (!input.at("optional") || !without.empty())
            words += " " + (connected || without.empty() ? clip + ".exr" : without);
        else if (connected)
            modifiers += ":" + input.at("slot").get<std::string>() + "=" + clip + ".exr";
        if (clip == "Source" && !space.empty())
            words += " --iscolorspace \"" + space + "\"";
    }
    Json given = values(effect, { time, 1, 1 });
    if (flag("anywindow")) {
        const ofx::RectD all = plane(effect, time);
        int x, y;
        effect.pair("origin", time, &x, &y);
        char window[96];
        std::snprintf(window, sizeof window, "%.0fx%.0f%+d%+d", all.x2 - all.x1, all.y2 - all.y1, x, y);
        given["window"] = window;
        given.erase("size");
    }
    for (const auto& [name, value] : given.items()) {
        const std::string text = value;
        modifiers += ":" + name + "=" + (text.find_first_of(": ") == std::string::npos ? text : "\"" + text + "\"");
    }
    const Json& shown       = output(effect, time);
    const std::string matte = shown.at("label") == "Matte" ? " \"" + effect.text("matte", time) + "\"" : "";
    return words + " --tex" + m_facts.at("op").get<std::string>() + modifiers + shown.at("after").get<std::string>()
           + matte + " -o " + m_facts.at("name").get<std::string>() + ".exr";
}

Json Node::plan(const Effect& effect, double time) const
{
    Json result = request(effect, { time, 1, 1 });
    for (const Json& input : m_facts.at("inputs")) {
        const Clip clip   = effect.clip(input.at("clip"));
        const auto region = clip.connected() ? clip.definition(frame_of(effect, input, time)) : std::nullopt;
        if (!region)
            continue;
        const double aspect = clip.properties.real("OfxImagePropPixelAspectRatio", 0, 1);
        const ofx::RectI whole { 0, 0, int(std::lround((region->x2 - region->x1) / (aspect > 0 ? aspect : 1))),
                                 int(std::lround(region->y2 - region->y1)) };
        const int channels = input.at("mask") ? 1 : channels_of(clip.properties);
        const std::string type = type_of(clip.properties), of_color = input.at("mask") ? "" : space(effect, time);
        result["inputs"].push_back(image_facts(input.at("slot"), whole, whole, channels ? channels : 4,
                                               type.empty() ? "float" : type, of_color, false));
    }
    return result;
}

ofx::Status Node::region_of_definition(const Effect& effect, const Properties& in, const Properties& out) const
{
    const double time = in.real("OfxPropTime");
    const char* name  = "OfxImageEffectPropRegionOfDefinition";
    if (flag("anywindow")) {
        set_region(out, name, plane(effect, time));
        return ofx::ok;
    }
    const Json& first = m_facts.at("inputs").at(0);
    const Clip source = effect.clip("Source");
    auto region       = source.connected() ? source.definition(frame_of(effect, first, time)) : std::nullopt;
    if (!region)
        return ofx::reply_default;
    Json asked             = plan(effect, time);
    const std::string text = asked.dump();
    Json facts             = places().find(text).value_or(Json());
    if (facts.is_null() && !lacks_space(effect, time))
        try {
            asked["do"] = "plan";
            facts = places().keep(text, process_of(effect).ask(asked, {}, [&](double) { return !effect.aborted(); }).facts);
        } catch (const Error&) {  // rendering shows it
        }
    if (facts.contains("place")) {
        const auto place = facts.at("place").get<std::array<int, 4>>(), full = facts.at("full").get<std::array<int, 4>>();
        const double aspect = source.properties.real("OfxImagePropPixelAspectRatio", 0, 1);
        region->x1 += (place[0] - full[0]) * aspect;
        region->y1 += full[1] + full[3] - (place[1] + place[3]);
        region->x2 = region->x1 + place[2] * aspect;
        region->y2 = region->y1 + place[3];
    }
    set_region(out, name, *region);
    return ofx::ok;
}

ofx::Status Node::regions_of_interest(const Effect& effect, const Properties& in, const Properties& out) const
{
    for (const Json& input : m_facts.at("inputs")) {
        const std::string clip = input.at("clip");
        const auto region      = effect.clip(clip).definition(frame_of(effect, input, in.real("OfxPropTime")));
        if (region)
            set_region(out, "OfxImageClipPropRoI_" + clip, *region);
    }
    return ofx::ok;
}

ofx::Status Node::frames_needed(const Effect& effect, const Properties& in, const Properties& out) const
{
    for (const Json& input : m_facts.at("inputs")) {
        const double frame     = frame_of(effect, input, in.real("OfxPropTime"));
        const std::string name = "OfxImageClipPropFrameRange_" + input.at("clip").get<std::string>();
        out.set(name.c_str(), frame, 0);
        out.set(name.c_str(), frame, 1);
    }
    return ofx::ok;
}

ofx::Status Node::is_identity(const Effect& effect, const Properties& in, const Properties& out) const
{
    const double time = in.real("OfxPropTime");
    if (!effect.clip("Source").connected() || !lacks_space(effect, time))
        return ofx::reply_default;
    effect.show_error(no_space);
    out.set("OfxPropName", "Source");
    out.set("OfxPropTime", time);
    return ofx::ok;
}

ofx::Status Node::output_space(const Effect& effect, const Properties&, const Properties& out) const
{
    out.set("OfxImageClipPropColourspace", keeps_space(effect) ? "OfxColourspace_Source" : "ofx_raw");
    return ofx::ok;
}

ofx::Status Node::created(const Effect& effect, const Properties&, const Properties&) const
{
    effect.set_text("line", line(effect, 0));
    if (!config_of(effect).empty())
        try {
            Json spaces          = process_of(effect).ask({ { "do", "spaces" } }).facts.at("spaces");
            const Properties own = effect.parameter_properties("spaces");
            spaces.insert(spaces.begin(), own.text("OfxParamPropChoiceOption"));
            own.reset("OfxParamPropChoiceOption");
            for (size_t n = 0; n < spaces.size(); ++n)
                own.set("OfxParamPropChoiceOption", spaces.at(n).get<std::string>(), int(n));
        } catch (const Error&) {  // rendering shows it
        }
    return ofx::ok;
}

ofx::Status Node::changed(const Effect& effect, const Properties& in, const Properties&) const
{
    const std::string name = in.text("OfxPropName");
    if (in.text("OfxPropChangeReason") != "OfxChangeUserEdited" || name == "line" || name == "verdict")
        return ofx::reply_default;
    const double time = in.real("OfxPropTime");
    const int chosen  = name == "spaces" ? effect.integer("spaces", time) : 0;
    if (chosen > 0) {
        effect.set_text("colorspace", effect.parameter_properties("spaces").text("OfxParamPropChoiceOption", chosen));
        effect.set_integer("spaces", 0);
    }
    if (name == "check") {
        if (lacks_space(effect, time))
            throw Error(no_space);
        std::vector<Input> images = inputs(effect, time);
        Json asked                = request(effect, { time, 1, 1 });
        asked.update({ { "channels", 4 }, { "type", "float" }, { "measure", true } });
        effect.set_text("verdict", frame(effect, asked, images, { time, 1, 1 })->facts.at("verdict"));
    }
    effect.set_text("line", line(effect, time));
    return ofx::ok;
}

std::vector<Input> Node::inputs(const Effect& effect, double time) const
{
    std::vector<Input> result;
    for (const Json& input : m_facts.at("inputs")) {
        const std::string name = input.at("clip");
        const Clip clip        = effect.clip(name);
        if (!clip.connected() && !input.at("optional"))
            throw Error(name + " is not connected");
        if (!clip.connected())
            continue;
        const double frame = frame_of(effect, input, time);
        const auto region  = clip.definition(frame);
        HostImage image(clip.handle, frame, region ? &*region : nullptr);
        if (!image)
            throw Error(name + " has no image of RGBA, RGB or alpha at frame " + number(frame));
        result.push_back({ input.at("slot"), std::move(image), input.at("mask") });
    }
    return result;
}

std::shared_ptr<const Frame> Node::frame(const Effect& effect, Json asked, const std::vector<Input>& images,
                                         const Moment& moment) const
{
    static auto& recent = *new Recent<std::shared_ptr<const Frame>>(4);  // a viewer that pans asks no process
    for (const Input& one : images)
        asked["inputs"].push_back(one.facts(one.mask ? "" : space(effect, moment.time)));
    const std::string key = key_of(asked, images) + config_of(effect);
    if (const auto found = recent.find(key))
        return *found;
    Process& process = process_of(effect);
    ProgressBar bar(effect);
    std::vector<Sent> sent;
    for (int tries = 3;; --tries) {
        try {
            Reply reply = process.ask({ { "do", "frame" }, { "key", key } }, {}, bar.watch());
            if (reply.facts.value("missing", false)) {
                for (size_t n = sent.size(); n < images.size(); ++n)
                    sent.push_back(images[n].sent());
                asked.update({ { "do", "frame" }, { "key", key } });
                reply = process.ask(asked, sent, bar.watch());
            }
            return recent.keep(key, std::make_shared<Frame>(reply));
        } catch (const Ended&) {
            if (tries == 1)
                throw;
        }
    }
}

ofx::Status Node::render(const Effect& effect, const Properties& in, const Properties&) const
{
    const Moment moment { in.real("OfxPropTime"), in.real("OfxImageEffectPropRenderScale", 0, 1),
                          in.real("OfxImageEffectPropRenderScale", 1, 1) };
    const ofx::RectI window = in.rectangle("OfxImageEffectPropRenderWindow");
    const HostImage out(effect.clip("Output").handle, moment.time, nullptr);
    if (!out)
        return ofx::failed;
    if (effect.aborted())
        return ofx::ok;
    if (lacks_space(effect, moment.time)) {
        effect.show_error(no_space);
        const Clip source = effect.clip("Source");
        copy_image(HostImage(source.connected() ? source.handle : nullptr, moment.time, nullptr), out, window);
        return ofx::ok;
    }
    const std::vector<Input> images = inputs(effect, moment.time);
    Json asked                      = request(effect, moment);
    asked.update({ { "channels", out.channels }, { "type", out.type } });
    ofx::RectI corner = images.at(0).image.definition;
    if (flag("anywindow")) {
        const ofx::RectD all = plane(effect, moment.time);
        int x, y;
        effect.pair("origin", moment.time, &x, &y);
        const long left = std::lround(x * moment.scale_x - all.x1 * moment.scale_x) + window.x1;
        const long top  = std::lround(y * moment.scale_y + all.y2 * moment.scale_y) - window.y2;
        char text[96];
        std::snprintf(text, sizeof text, "%dx%d%+ld%+ld", window.x2 - window.x1, window.y2 - window.y1, left, top);
        asked["values"]["window"] = text;
        if (!asked["values"].contains("tiles"))
            asked["values"].erase("size");
        corner = window;
    }
    const auto made = frame(effect, asked, images, moment);
    if (!flag("anywindow")) {
        const auto place = made->facts.at("place").get<std::array<int, 4>>();
        const auto full  = made->facts.at("full").get<std::array<int, 4>>();
        corner.x1 += place[0] - full[0];
        corner.y1 += full[1] + full[3] - (place[1] + place[3]);
        if (moment.scale_x == 1)
            places().keep(plan(effect, moment.time).dump(), made->facts);
    }
    made->copy(corner.x1, corner.y1, out, window);
    effect.clear_error();
    return ofx::ok;
}

}  // namespace oiiotex
