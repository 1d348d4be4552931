/* A stand-in for several GPUs, for tests: an EGL that shows more devices than there are, all of them one real device.

   SHIM_DEVICES has a word for each: the ordinal that CUDA gives it or `-` for no device of CUDA's, with `!` behind it
   where it cannot be initialised: `1,0,-!`. Every context that is made adds a line `ORDINAL PID` to the file that
   SHIM_CONTEXTS names, which nvml.c reads as memory. What is not here is the real library's, on which this one leans. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef unsigned int Bool;
typedef void *Any;
enum { MOST = 32, DEVICE = 0x322C, EXTENSIONS = 0x3055, CUDA = 0x323A, PLATFORM_DEVICE = 0x313F };
enum { SUCCESS = 0x3000, NOT_INITIALIZED = 0x3001, BAD_ATTRIBUTE = 0x3004 };

static char devices[MOST], displays[MOST]; /* only their addresses are used */
static __thread int failure = SUCCESS;
static __thread Any shown = NULL;

static Any real(const char *name) {
  static Any library;
  if (!library) library = dlopen(REAL, RTLD_LAZY | RTLD_LOCAL | RTLD_DEEPBIND);
  Any found = dlsym(library, name);
  if (found) return found;
  Any (*find)(const char *) = (Any (*)(const char *))dlsym(library, "eglGetProcAddress");
  return find(name);
}

#define REALLY(result, name, ...) ((result(*)(__VA_ARGS__))real(name))

static const char *word(int index) {
  const char *at = getenv("SHIM_DEVICES");
  while (at && index--) at = (at = strchr(at, ',')) ? at + 1 : NULL;
  return at;
}

static int count(void) {
  int number = 0;
  while (number < MOST && word(number)) number++;
  return number;
}

static int place(Any handle, char *table) {
  long at = (char *)handle - table;
  return at >= 0 && at < MOST ? (int)at : -1;
}

static int broken(int index) { return word(index)[strcspn(word(index), ",!")] == '!'; }
static int ordinal(int index) { return word(index)[0] == '-' ? -1 : atoi(word(index)); }

static Any device(void) {
  Any found = NULL;
  int number = 0;
  REALLY(Bool, "eglQueryDevicesEXT", int, Any *, int *)(1, &found, &number);
  return found;
}

static Any display(Any handle) {
  if (place(handle, displays) < 0) return handle;
  return REALLY(Any, "eglGetPlatformDisplayEXT", unsigned, Any, const int *)(PLATFORM_DEVICE, device(), NULL);
}

Bool eglQueryDevicesEXT(int most, Any *found, int *number) {
  *number = !found || count() < most ? count() : most;
  for (int i = 0; found && i < *number; i++) found[i] = &devices[i];
  return 1;
}

Any eglGetPlatformDisplayEXT(unsigned platform, Any native, const int *attributes) {
  int at = place(native, devices);
  if (platform == PLATFORM_DEVICE && at >= 0) return &displays[at];
  return REALLY(Any, "eglGetPlatformDisplayEXT", unsigned, Any, const int *)(platform, native, attributes);
}

const char *eglQueryDeviceStringEXT(Any asked, int name) {
  static char text[400];
  int at = place(asked, devices);
  const char *said = REALLY(const char *, "eglQueryDeviceStringEXT", Any, int)(at < 0 ? asked : device(), name);
  if (at < 0 || name != EXTENSIONS || ordinal(at) < 0) return said;
  snprintf(text, sizeof text, "%s EGL_NV_device_cuda", said ? said : "");
  return text;
}

Bool eglQueryDeviceAttribEXT(Any asked, int name, long *value) {
  int at = place(asked, devices);
  if (at >= 0 && name == CUDA && ordinal(at) >= 0) {
    *value = ordinal(at);
    return 1;
  }
  failure = BAD_ATTRIBUTE;
  return 0;
}

Bool eglQueryDisplayAttribEXT(Any asked, int name, Any *value) {
  int at = place(asked, displays);
  if (at < 0 || name != DEVICE)
    return REALLY(Bool, "eglQueryDisplayAttribEXT", Any, int, Any *)(display(asked), name, value);
  *value = &devices[at];
  return 1;
}

int eglGetError(void) {
  int told = failure;
  failure = SUCCESS;
  return told == SUCCESS ? REALLY(int, "eglGetError", void)() : told;
}

Bool eglInitialize(Any asked, int *major, int *minor) {
  int at = place(asked, displays);
  if (at >= 0 && broken(at)) {
    failure = NOT_INITIALIZED;
    return 0;
  }
  return REALLY(Bool, "eglInitialize", Any, int *, int *)(display(asked), major, minor);
}

Any eglCreateContext(Any asked, Any config, Any shared, const int *attributes) {
  int at = place(asked, displays), file;
  const char *path = getenv("SHIM_CONTEXTS");
  if (at >= 0 && path && (file = open(path, O_WRONLY | O_APPEND | O_CREAT, 0644)) >= 0) {
    dprintf(file, "%d %d\n", ordinal(at), (int)getpid());
    close(file);
  }
  return REALLY(Any, "eglCreateContext", Any, Any, Any, const int *)(display(asked), config, shared, attributes);
}

Bool eglMakeCurrent(Any asked, Any draw, Any read, Any context) {
  Bool made = REALLY(Bool, "eglMakeCurrent", Any, Any, Any, Any)(display(asked), draw, read, context);
  if (made) shown = context ? asked : NULL;
  return made;
}

Any eglGetCurrentDisplay(void) {
  return place(shown, displays) < 0 ? REALLY(Any, "eglGetCurrentDisplay", void)() : shown;
}

Bool eglTerminate(Any asked) {
  return place(asked, displays) < 0 ? REALLY(Bool, "eglTerminate", Any)(asked) : 1; /* others are the same one */
}

Bool eglChooseConfig(Any asked, const int *attributes, Any *configs, int size, int *number) {
  return REALLY(Bool, "eglChooseConfig", Any, const int *, Any *, int, int *)(display(asked), attributes, configs, size, number);
}

Bool eglGetConfigAttrib(Any asked, Any config, int name, int *value) {
  return REALLY(Bool, "eglGetConfigAttrib", Any, Any, int, int *)(display(asked), config, name, value);
}

Bool eglDestroyContext(Any asked, Any context) {
  return REALLY(Bool, "eglDestroyContext", Any, Any)(display(asked), context);
}

const char *eglQueryString(Any asked, int name) {
  return REALLY(const char *, "eglQueryString", Any, int)(display(asked), name);
}

Any eglCreatePbufferSurface(Any asked, Any config, const int *attributes) {
  return REALLY(Any, "eglCreatePbufferSurface", Any, Any, const int *)(display(asked), config, attributes);
}

Bool eglDestroySurface(Any asked, Any surface) {
  return REALLY(Bool, "eglDestroySurface", Any, Any)(display(asked), surface);
}

#define OURS(name) if (!strcmp(asked, #name)) return (Any)name

Any eglGetProcAddress(const char *asked) {
  OURS(eglQueryDevicesEXT);
  OURS(eglGetPlatformDisplayEXT);
  OURS(eglQueryDeviceStringEXT);
  OURS(eglQueryDeviceAttribEXT);
  OURS(eglQueryDisplayAttribEXT);
  return REALLY(Any, "eglGetProcAddress", const char *)(asked);
}
