"""Raw messages, in any encoding -> what they say."""
