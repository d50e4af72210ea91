/*
 * FMI 2.0 for co-simulation around {{ name }}.c.
 * Written by minorloop {{ version }}. The types are those of the standard on platforms where it says
 * "default": Functional Mock-up Interface 2.0, section 2.1.2.
 */
#include "{{ name }}.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define API __declspec(dllexport)
#elif defined(__GNUC__)
#define API __attribute__((visibility("default")))
#else
#define API
#endif

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef int fmi2StatusKind;
typedef void (*fmi2Logger)(void *, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef struct {
    fmi2Logger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    {{ name }}_state state;
    double u;
} memory_t;

typedef struct {
    memory_t now;
    fmi2Logger logger;
    void *environment;
    char name[64];
} instance_t;

static const char guid[] = "{{ guid }}";

/* Bytes from outside may be anything; a state has its counts and places in range. */
static int is_sound(const memory_t *kept)
{
    int32_t k;
    int sound = (kept->state.count >= 0) && (kept->state.count < {{ guard }}_MEMORY)
        && (kept->state.weighed >= 1) && (kept->state.weighed <= {{ guard }}_MEMORY) && isfinite(kept->u);
{%- if linear and linear.lag %}

    sound = sound && (kept->state.next >= 0) && (kept->state.next < {{ linear.lag }});
{%- endif %}

    for (k = 0; sound && (k <= kept->state.count); ++k) {
        const int32_t band = kept->state.past[k].band;
        sound = (band >= 0) && (band < {{ bands }});
    }
    return sound;
}

static fmi2Status refuse(const instance_t *instance, const char *message)
{
    if ((instance != NULL) && (instance->logger != NULL)) {
        instance->logger(instance->environment, instance->name, fmi2Error, "error", "%s", message);
    }
    return fmi2Error;
}

{% for function in prototypes -%}
{{ function }};
{% endfor %}
const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

const char *fmi2GetVersion(void)
{
    return "2.0";
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String id, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    instance_t *instance = NULL;

    (void)resources;
    (void)visible;
    (void)logging;
    if ((type == fmi2CoSimulation) && (id != NULL) && (strcmp(id, guid) == 0)) {
        instance = calloc(1, sizeof *instance);
    }
    if (instance != NULL) {
        instance->logger = (functions != NULL) ? functions->logger : NULL;
        instance->environment = (functions != NULL) ? functions->componentEnvironment : NULL;
        if (name != NULL) {
            (void)strncpy(instance->name, name, sizeof instance->name - 1);
        }
        (void)fmi2Reset(instance);
    }
    return instance;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    instance_t *const instance = c;

    {{ name }}_reset(&instance->now.state);
    instance->now.u = {{ start }};
    return fmi2OK;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[])
{
    (void)c;
    (void)on;
    (void)count;
    (void)names;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    (void)c;
    (void)has_tolerance;
    (void)tolerance;
    (void)start;
    (void)has_stop;
    (void)stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[])
{
    const instance_t *const instance = c;
    fmi2Status status = fmi2OK;
    size_t k;

    for (k = 0; k < count; ++k) {
        if (vr[k] == 0u) {
            value[k] = instance->now.u;
        } else if (vr[k] == 1u) {
            value[k] = {{ name }}_output(&instance->now.state);
        } else if (vr[k] == 2u) {
            value[k] = {{ name }}_error_bound(&instance->now.state);
        } else {
            status = refuse(instance, "there is no such real variable");
        }
    }
    return status;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[])
{
    instance_t *const instance = c;
    fmi2Status status = fmi2OK;
    size_t k;

    for (k = 0; k < count; ++k) {
        if (vr[k] != 0u) {
            status = refuse(instance, "only the input can be set");
        } else if (!isfinite(value[k])) {
            status = refuse(instance, "the input is not a finite number");
        } else {
            instance->now.u = value[k];
        }
    }
    return status;
}

/* The input that is set now is held over the step. */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_return)
{
    instance_t *const instance = c;
    fmi2Status status = fmi2OK;
{%- if linear %}
    const double wanted = size / {{ linear.interval }};
    const double whole = floor(wanted + 0.5);
    double k;
{%- endif %}

    (void)time;
    (void)no_return;
{%- if linear %}
    if ((size <= 0.0) || (whole < 1.0) || (fabs(wanted - whole) > 1e-6 * whole)) {
        status = refuse(instance, "a step must be a whole number of {{ linear.interval }} s");
    } else {
        for (k = 0.0; k < whole; k += 1.0) {
            (void){{ name }}_step(&instance->now.state, instance->now.u);
        }
    }
{%- else %}
    if (size < 0.0) {
        status = refuse(instance, "a step cannot go back in time");
    } else {
        (void){{ name }}_step(&instance->now.state, instance->now.u);
    }
{%- endif %}
    return status;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refuse(c, "steps are done at once and cannot be cancelled");
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    const instance_t *const instance = c;

    if (*kept == NULL) {
        *kept = malloc(sizeof instance->now);
    }
    if (*kept == NULL) {
        return refuse(instance, "there is no memory for another state");
    }
    (void)memcpy(*kept, &instance->now, sizeof instance->now);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate kept)
{
    instance_t *const instance = c;

    if (kept == NULL) {
        return refuse(instance, "there is no state to go back to");
    }
    (void)memcpy(&instance->now, kept, sizeof instance->now);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    (void)c;
    if (kept != NULL) {
        free(*kept);
        *kept = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate kept, size_t *size)
{
    (void)c;
    (void)kept;
    *size = sizeof(memory_t);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate kept, fmi2Byte bytes[], size_t size)
{
    if ((kept == NULL) || (size < sizeof(memory_t))) {
        return refuse(c, "there is no state, or no room for it");
    }
    (void)memcpy(bytes, kept, sizeof(memory_t));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *kept)
{
    memory_t wanted;

    if (size != sizeof wanted) {
        return refuse(c, "these bytes are no state of this unit");
    }
    (void)memcpy(&wanted, bytes, sizeof wanted);
    if (!is_sound(&wanted)) {
        return refuse(c, "these bytes are no state of this unit");
    }
    if (*kept == NULL) {
        *kept = malloc(sizeof(memory_t));
    }
    if (*kept == NULL) {
        return refuse(c, "there is no memory for another state");
    }
    (void)memcpy(*kept, &wanted, sizeof wanted);
    return fmi2OK;
}
{% for kind in ["Integer", "Boolean", "String"] %}
fmi2Status fmi2Get{{ kind }}(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       fmi2{{ kind }} value[])
{
    (void)vr;
    (void)value;
    return (count == 0u) ? fmi2OK : refuse(c, "all variables are real");
}

fmi2Status fmi2Set{{ kind }}(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       const fmi2{{ kind }} value[])
{
    (void)vr;
    (void)value;
    return (count == 0u) ? fmi2OK : refuse(c, "all variables are real");
}

fmi2Status fmi2Get{{ kind }}Status(fmi2Component c, const fmi2StatusKind kind, fmi2{{ kind }} *value)
{
    (void)kind;
    (void)value;
    (void)refuse(c, "steps are done at once and have no status");
    return fmi2Discard;
}
{% endfor %}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    (void)value;
    (void)refuse(c, "steps are done at once and have no status");
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    (void)kind;
    (void)value;
    (void)refuse(c, "steps are done at once and have no status");
    return fmi2Discard;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference known[],
                                        size_t knowns, const fmi2Real change[], fmi2Real value[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)change;
    (void)value;
    return refuse(c, "there are no derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)count;
    (void)order;
    (void)value;
    return refuse(c, "there are no derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)count;
    (void)order;
    (void)value;
    return refuse(c, "there are no derivatives");
}
