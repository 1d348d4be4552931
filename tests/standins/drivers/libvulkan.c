/* A stand-in for Vulkan's loader: the GPUs of the other file, and Mesa's software as the second of them, as in
 * https://github.com/PKU-MARL/DexterousHands/issues/12. Structures as in the Vulkan specification, 1.1. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

typedef struct {
    uint32_t type;
    void *next;
    uint32_t api, driver, vendor, device, kind;
    char name[256];
    uint8_t rest[548];
} Properties2;

typedef struct {
    uint32_t type;
    void *next;
    uint8_t uuid[16], driver[16], luid[8];
    uint32_t mask, luid_valid;
} Identity;

typedef struct {
    uint32_t type;
    void *next;
    uint32_t flags;
    struct {
        uint32_t type;
        void *next;
        const char *name;
        uint32_t version;
        const char *engine;
        uint32_t engine_version, api;
    } *application;
} Creation;

enum { SOFTWARE = 1, WRONG = -3 };

int vkCreateInstance(const Creation *creation, const void *allocator, void **instance) {
    if (creation->type != 1 || creation->application->api != (1 << 22 | 1 << 12)) return WRONG;
    *instance = (void *)0x1234;
    return 0;
}

int vkEnumeratePhysicalDevices(void *instance, uint32_t *count, void **devices) {
    if (instance != (void *)0x1234) return WRONG;
    for (uint32_t i = 0; devices && i < *count; i++) devices[i] = (void *)(0xabc000000000 + i);
    *count = GPUS + 1;
    return 0;
}

void vkGetPhysicalDeviceProperties2(void *device, Properties2 *properties) {
    int number = (int)((uint64_t)device - 0xabc000000000);
    int software = number == SOFTWARE;
    Identity *identity = properties->next;
    if (properties->type != 1000059001 || identity->type != 1000071004) return;
    properties->kind = software ? 4 : 2;
    snprintf(properties->name, 256, software ? "llvmpipe" : "Stand-in GPU");
    memset(identity->uuid, software ? 0x11 : 0xa0 + number - (number > SOFTWARE), 16);
}
