/* A camera in a file, for LD_PRELOAD: answers the requests of Video4Linux for the file FAKE_CAMERA.
   YUYV 64 x 48 at 25/s. FAKE_PICTURES is how many come; then it waits for ever, or with FAKE_END=ENODEV is gone. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <linux/videodev2.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { WIDTH = 64, HEIGHT = 48, SIZE = WIDTH * HEIGHT * 2, BUFFERS = 256, PAGE = 8192 };
static int queued[BUFFERS], first, count, given;
static volatile int is_on;

static int is_camera(int fd) {
    struct stat own, camera;
    const char *path = getenv("FAKE_CAMERA");
    return path && !fstat(fd, &own) && !stat(path, &camera) && own.st_ino == camera.st_ino;
}

static int fail(int reason) {
    errno = reason;
    return -1;
}

static int next_picture(struct v4l2_buffer *buffer) {
    struct timespec pause = {0, 40000000}, now;
    const char *limit = getenv("FAKE_PICTURES");
    nanosleep(&pause, NULL);
    while (is_on && ((limit && given >= atoi(limit)) || !count)) {
        if (getenv("FAKE_END")) return fail(ENODEV);
        nanosleep(&pause, NULL);
    }
    if (!is_on) return fail(EINVAL);
    given++;
    clock_gettime(CLOCK_MONOTONIC, &now);
    buffer->index = queued[first];
    first = (first + 1) % BUFFERS, count--;
    buffer->bytesused = buffer->length = SIZE;
    buffer->timestamp.tv_sec = now.tv_sec, buffer->timestamp.tv_usec = now.tv_nsec / 1000;
    return 0;
}

static void describe(struct v4l2_format *format) {
    format->fmt.pix.width = WIDTH, format->fmt.pix.height = HEIGHT;
    format->fmt.pix.pixelformat = V4L2_PIX_FMT_YUYV, format->fmt.pix.field = V4L2_FIELD_NONE;
    format->fmt.pix.bytesperline = WIDTH * 2, format->fmt.pix.sizeimage = SIZE;
}

static int answer(int fd, unsigned long request, void *value) {
    struct v4l2_buffer *buffer = value;
    switch (request) {
    case VIDIOC_QUERYCAP:
        ((struct v4l2_capability *)value)->capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        return 0;
    case VIDIOC_G_FMT: case VIDIOC_S_FMT: describe(value); return 0;
    case VIDIOC_G_INPUT: *(int *)value = 0; return 0;
    case VIDIOC_ENUMINPUT: ((struct v4l2_input *)value)->std = 0; return 0;
    case VIDIOC_G_PARM: case VIDIOC_S_PARM: {
        struct v4l2_captureparm *capture = &((struct v4l2_streamparm *)value)->parm.capture;
        capture->capability = V4L2_CAP_TIMEPERFRAME;
        capture->timeperframe.numerator = 1, capture->timeperframe.denominator = 25;
        return 0;
    }
    case VIDIOC_REQBUFS:
        return ftruncate(fd, (off_t)BUFFERS * PAGE);
    case VIDIOC_QUERYBUF: buffer->length = SIZE, buffer->m.offset = buffer->index * PAGE; return 0;
    case VIDIOC_QBUF: queued[(first + count++) % BUFFERS] = buffer->index; return 0;
    case VIDIOC_DQBUF: return next_picture(buffer);
    case VIDIOC_STREAMON: is_on = 1; return 0;
    case VIDIOC_STREAMOFF: is_on = 0, count = 0; return 0;
    default: return fail(ENOTTY);
    }
}

int ioctl(int fd, unsigned long request, ...) {
    static int (*real)(int, unsigned long, ...);
    va_list rest;
    va_start(rest, request);
    void *value = va_arg(rest, void *);
    va_end(rest);
    if (is_camera(fd)) return answer(fd, request & 0xffffffffUL, value);
    if (!real) real = (int (*)(int, unsigned long, ...))dlsym(RTLD_NEXT, "ioctl");
    return real(fd, request, value);
}
