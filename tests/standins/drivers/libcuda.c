/* A stand-in for CUDA's driver: GPUS devices. Names and arguments as in NVIDIA's "CUDA Driver API". */
#include <stdio.h>
#include <string.h>

int cuInit(unsigned flags) { return 0; }

int cuDeviceGetCount(int *count) {
    *count = GPUS;
    return 0;
}

int cuDeviceGet(int *device, int ordinal) {
    *device = ordinal;
    return 0;
}

int cuDeviceGetName(char *name, int size, int device) {
    snprintf(name, size, "Stand-in GPU");
    return 0;
}

int cuDeviceGetUuid(char *uuid, int device) {
    memset(uuid, 0xa0 + device, 16);
    return 0;
}
