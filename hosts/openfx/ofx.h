// SPDX-License-Identifier: Apache-2.0
// The facts of OpenFX's C interface (version 1.5) that the plugin needs: layouts of tables of functions, and names. Names of
// members are ours; their order and types are what a host provides. Functions that are not called are `Unused`.
#pragma once

namespace ofx {

using Status = int;
constexpr Status ok = 0, failed = 1, fatal = 2, unknown = 3, missing_feature = 4, out_of_memory = 8, reply_no = 13,
                 reply_default = 14;

using Unused = void (*)();

struct RectI {
    int x1, y1, x2, y2;
};
struct RectD {
    double x1, y1, x2, y2;
};

// Handles are opaque.
struct PropertySuite {
    Status (*set_pointer)(void* set, const char* name, int index, void* value);
    Status (*set_string)(void* set, const char* name, int index, const char* value);
    Status (*set_double)(void* set, const char* name, int index, double value);
    Status (*set_int)(void* set, const char* name, int index, int value);
    Unused set_several[4];
    Status (*get_pointer)(void* set, const char* name, int index, void** value);
    Status (*get_string)(void* set, const char* name, int index, char** value);
    Status (*get_double)(void* set, const char* name, int index, double* value);
    Status (*get_int)(void* set, const char* name, int index, int* value);
    Unused get_several[4];
    Status (*reset)(void* set, const char* name);
    Status (*dimension)(void* set, const char* name, int* count);
};

struct EffectSuite {
    Status (*properties)(void* effect, void** set);
    Status (*parameters)(void* effect, void** parameters);
    Status (*define_clip)(void* effect, const char* name, void** set);
    Status (*clip)(void* effect, const char* name, void** clip, void** set);
    Unused clip_properties;
    Status (*image)(void* clip, double time, const RectD* region, void** image);
    Status (*release)(void* image);
    Status (*region_of_definition)(void* clip, double time, RectD* region);
    int (*aborted)(void* effect);
    Unused memory[4];
};

struct ParameterSuite {
    Status (*define)(void* parameters, const char* type, const char* name, void** set);
    Status (*parameter)(void* parameters, const char* name, void** parameter, void** set);
    Unused properties[2];
    Unused value;
    Status (*value_at)(void* parameter, double time, ...);
    Unused calculus[2];
    Status (*set)(void* parameter, ...);
    Unused keys[9];
};

struct MessageSuite {  // version 2
    Status (*message)(void* effect, const char* type, const char* id, const char* format, ...);
    Status (*set_persistent)(void* effect, const char* type, const char* id, const char* format, ...);
    Status (*clear_persistent)(void* effect);
};

struct ProgressSuite {
    Status (*start)(void* effect, const char* label);
    Status (*update)(void* effect, double share);
    Status (*end)(void* effect);
};

struct Host {
    void* properties;
    const void* (*suite)(void* properties, const char* name, int version);
};

struct Plugin {
    const char* api;
    int api_version;
    const char* identifier;
    unsigned major, minor;
    void (*set_host)(Host* host);
    Status (*main)(const char* action, const void* effect, void* in, void* out);
};

}  // namespace ofx
